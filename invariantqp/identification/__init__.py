"""Contact identification: the kind and place of a contact from a recording of poses and wrenches.

In: poses of the tool frame and wrenches, from arrays or from a file.
Out: an `Identification` with its candidates, each of which makes a `Contact` and a `HybridTask`.
`recording.py` checks arrays, `recording_files.py` reads files, `models.py` has the kinds as constraints, `fit.py` fits
one kind, `hypotheses.py` tests all, `identify.py` splits the recording into contacts.
The room must not know controllers, loops or views.
"""
