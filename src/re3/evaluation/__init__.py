"""How well and how fast trackers follow annotated clips."""
