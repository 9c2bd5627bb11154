"""Training data packed into shards: decoded once, scaled, encoded compactly.

`pack` writes the sources of a mix as shards, `read_shards` reads them. Reading needs NumPy and
Pillow, neither a video decoder nor OpenCV.
"""
