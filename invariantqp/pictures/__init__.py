"""Pictures of runs, of contact and of the pitches of an arm, written to files."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.pictures.pitches import pitch_picture as pitch_picture
    from invariantqp.pictures.run import picture as picture
