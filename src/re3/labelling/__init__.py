"""Training tracks from video without annotation, labelled by trackers that agree.

`regions` finds where an object may be, `agreement` follows it with two trackers forward and
backward, `tracks` keeps the stretches where they agree, `videos` does this for whole videos and
`check` measures on annotated clips how accurate the kept boxes are.
"""
