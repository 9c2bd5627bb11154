"""Which frames of all objects are tracked, and which are not."""

from __future__ import annotations

from re3.apps.server.annotation import Objects, Segment


def last_known(objects: Objects) -> int | None:
    """The last frame in which any object is known, or None without objects."""
    return max((each.last_known for each in objects.values()), default=None)


def tracked_until(objects: Objects) -> int | None:
    """The last frame up to which all objects are known without a gap, or None without objects."""
    last = last_known(objects)
    if last is None:
        return None
    gaps = (first for each in objects.values() for first, _ in each.gaps(last))
    return min(gaps, default=last + 1) - 1


def last_known_before(objects: Objects, index: int) -> int:
    """The latest frame up to `index` in which all objects are known."""
    while behind := [
        each.segment_at(index) for each in objects.values() if not each.is_known(index)
    ]:
        index = min(segment.until for segment in behind if segment is not None)
    return index


def untracked(objects: Objects, end: int) -> list[str]:
    """What is not tracked up to frame `end`, an object each, for people."""
    told = []
    for each in objects.values():
        gaps = list(each.gaps(end))
        if gaps:
            frames = ", ".join(f"{a} to {b}" if b > a else f"{a}" for a, b in gaps)
            several = len(gaps) > 1 or gaps[0][0] < gaps[0][1]
            told.append(f"{each.name} in {'frames' if several else 'frame'} {frames}")
    return told


def wanted(objects: Objects) -> list[tuple[Segment, int]]:
    """Segments that are to be tracked further without being asked, and up to which frame."""
    found = []
    for each in objects.values():
        for at, segment in each.key_frames.items():
            if segment is not None:
                following = each.key_frame_after(at)
                last = segment.wanted if following is None else following - 1
                found.append((segment, min(segment.wanted, last)))
    return [(segment, until) for segment, until in found if segment.until < until]
