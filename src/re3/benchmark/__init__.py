"""Measuring speed: contenders in turn on the same frames, memory, plots and what to choose."""
