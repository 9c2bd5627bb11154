"""Training from packed data: frames on the device, crops and scenes made there in batches.

`draw` decides on the host, with NumPy, what each clip shows; `render` and `photometric` make its
crops on the device; `rollout` walks a batch of clips and `trainer` learns from them.
"""
