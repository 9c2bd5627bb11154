"""re3: a real-time tracker of any object in video.

>>> import re3
>>> tracker = re3.Tracker()
>>> tracker.init(frame_bgr, (x, y, w, h))
>>> result = tracker.update(next_frame_bgr)
>>> result.box_xywh, result.score, result.status
"""

from re3.interop import TrackerRe3
from re3.result import Result, Status
from re3.tracker import MultiTracker, Tracker

__all__ = ["MultiTracker", "Result", "Status", "Tracker", "TrackerRe3", "__version__"]

__version__ = "0.1.0"
