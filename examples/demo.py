"""Track the bundled clip: what `make demo` runs.

python examples/demo.py
"""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
CLIP = HERE / "clips" / "person.mp4"
BOX = "368,58,158,374"
"""The person in the first frame: left, top, width, height in pixels."""

OUT = HERE.parent / "out"


def main() -> int:
    """Run `re3 track` on the clip and say what to try next."""
    command = ["track", str(CLIP), "--box", BOX]
    command += ["--out", str(OUT / "demo.mp4"), "--results", str(OUT / "demo.csv")]
    print(f"re3 {shlex.join(command)}\n", flush=True)
    done = subprocess.run([sys.executable, "-m", "re3", *command], check=False)
    if done.returncode == 0:
        re3 = Path(sys.executable).parent / "re3"
        print(
            f"\nWatch {OUT / 'demo.mp4'}. Then try a video of your own:\n"
            f"  {re3} track VIDEO --box X,Y,W,H --out tracked.mp4\n"
            "X,Y,W,H is the object in the first frame: left, top, width and height in pixels."
        )
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
