"""What can go wrong in training."""


class TrainingError(RuntimeError):
    """Training cannot go on; the message says why and what was kept."""
