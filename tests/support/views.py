"""A short task to look at, and a reader of pages."""

from html.parser import HTMLParser

from support.arms import READY

TASK = {
    "name": "short",
    "about": "A short line.",
    "robot": {"source": "panda", "start": list(READY["panda"])},
    "path": {"kind": "line", "duration": 1.0, "move": [0.1, 0.2, 0.05], "turn": [0.0, 0.0, 0.4]},
    "law": {"dt": 0.01},
}


class Reader(HTMLParser):
    """Tags with their attributes, and the text of each script."""

    def __init__(self):
        super().__init__()
        self.tags, self.scripts, self._script = [], [], False

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self._script = tag == "script"

    def handle_endtag(self, tag):
        self._script = False

    def handle_data(self, data):
        if self._script:
            self.scripts.append(data)


def read(text):
    reader = Reader()
    reader.feed(text)
    reader.close()
    return reader
