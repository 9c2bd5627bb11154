"""`re3 data pack`: training data in a form that one GPU can train from."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from re3.apps.console import INTERRUPTED, failed, stderr


def pack(
    mix: Annotated[
        Path, typer.Argument(help="A mix, as for `re3 train --mix`.", metavar="MIX.yaml")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder of the shards; empty.", metavar="DIR")
    ],
    shard_mb: Annotated[
        float, typer.Option("--shard-mb", help="Largest size of a shard, in megabytes.", min=0.1)
    ] = 24.0,
    longer_side: Annotated[
        int,
        typer.Option(
            help="Scale videos down to a longer side of so many pixels; stills stay.", min=16
        ),
    ] = 400,
    object_side: Annotated[
        float,
        typer.Option(
            help="... but no further than to a median object size (root of the area) of so many "
            "pixels.",
            min=0.0,
        ),
    ] = 40.0,
    quality: Annotated[int, typer.Option(help="Of the AVIF encoder.", min=1, max=100)] = 60,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", "-j", help="Processes. Default: all cores.", min=1, show_default=False
        ),
    ] = None,
) -> None:
    """Pack the sources of a mix into shards, for `re3 train --packed`.

    Videos are decoded, scaled and encoded as AVIF, with the boxes of all
    tracks; stills with their masks. The shards are all that training needs:
    neither the videos nor a video decoder. The sampling of the mix is part
    of them.

    Example:

        re3 data pack mix.yaml --out packed --shard-mb 24
    """
    try:
        import PIL.features

        from re3.data.mix import mix_sources, read_mix
        from re3.data.packed.pack import PackConfig, Packed
        from re3.data.packed.pack import pack as pack_sources
    except ImportError as error:
        raise failed(
            f"packing needs more than tracking does ({error}): pip install 're3[train]'"
        ) from error
    if not PIL.features.check("avif"):
        raise failed("this Pillow cannot write AVIF; expected 11.3 or newer: pip install -U pillow")
    console = stderr()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    try:
        config = PackConfig(longer_side, object_side, quality, shard_mb)
        read = read_mix(mix)
        sources = mix_sources(read)
        with (
            Progress(*columns, console=console, disable=not console.is_terminal) as bar,
            ProcessPoolExecutor(jobs or os.cpu_count()) as pool,
        ):
            task = bar.add_task("videos and stills", total=None)

            def report(packed: Packed) -> None:
                bar.update(task, completed=packed.done, total=packed.total)

            packed = pack_sources(read, sources, out, config, pool, report)
    except (OSError, ValueError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        console.print("interrupted; no shard is left", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    console.print(
        f"{out}: {packed.done} videos and stills in {packed.shards} shards, "
        f"{packed.bytes / 1e6:.1f} MB",
        markup=False,
    )
