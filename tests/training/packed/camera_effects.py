"""A camera without effects."""

from re3.data.photometric_config import PhotometricConfig

NO_EFFECTS = PhotometricConfig(
    gain=0, offset=0, tint=0, waver=0, weather=0, grey=0, blur=0, motion_blur=0, noise=0, jpeg=0
)
"""Crops as they are: no camera effects."""
