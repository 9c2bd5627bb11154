"""How near re3 comes to what this machine can do: arithmetic and memory measured on the spot.

    python benchmarks/limits.py
    python benchmarks/limits.py --model re3-lite --model paper.onnx --threads 1

Prints the rate of large matrix products (fp32 and 8 bits, by ONNX Runtime, which runs the networks
as well) and of reading memory. Then, for each part of a step of a model, its arithmetic, the bytes
it touches, the time it takes by ONNX Runtime's own profile and the shortest time that either rate
allows: the larger of arithmetic / rate and bytes / rate. The bytes of a part are its weights and
the tensors that go in and out of its operators; those that stay in a cache come faster than from
memory, so that a part may be above 100 % of its limit. Needs `pip install -e ".[train]"` for the
package onnx. `re3 export re3 paper.onnx --untrained` writes the paper's network.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper

SIDE = 1024
"""Of the square matrices multiplied."""

STEPS = 40
WARM_UP = 5

PARTS = (
    # Part of a step, and what the names of its operators hold; the first that fits counts.
    (
        "trunk",
        (
            "trunk",
            "/conv.",
        ),
    ),
    ("embedding", ("embedding", "skip")),
    ("correlation", ("correlate", "object_part", "fuse", "squeeze")),
    ("fully connected", ("fully_connected",)),
    ("LSTM", ("lstm",)),
    ("readout", ("refine", "heat", "modulate", "residual", "score", "corners")),
)
OTHER = "other"


@dataclass
class Work:
    """What a part does in one step.

    Attributes:
        operations: multiplications and additions.
        bytes: read and written.
        seconds: it took, by the profile.
    """

    operations: float = 0.0
    bytes: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True)
class Machine:
    """Rates measured here: operations a second in fp32 and in 8 bits, bytes a second."""

    fp32: float
    int8: float
    memory: float


def main() -> None:
    """Measure the machine, then each model, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", action="append", help="name or .onnx file; several times")
    parser.add_argument("--threads", type=int, default=0, help="0: one for each core")
    arguments = parser.parse_args()
    from re3.evaluation.environment import Environment

    here = Environment.here()
    print(f"{here.cpu}, {here.cores} cores, load {here.load:.1f} before; {here.date}")
    machine = measure_machine(arguments.threads, here.cores)
    print(f"matrix product of {SIDE} x {SIDE}, fp32:   {machine.fp32 / 1e9:7.0f} GFLOP/s")
    print(f"matrix product of {SIDE} x {SIDE}, 8 bits: {machine.int8 / 1e9:7.0f} GOP/s")
    print(f"reading memory:                        {machine.memory / 1e9:7.1f} GB/s")
    for model in arguments.model or ["re3-lite"]:
        show(model, machine, arguments.threads)


def measure_machine(threads: int, cores: int) -> Machine:
    """The machine's rates with so many threads."""
    rng = np.random.default_rng(0)
    floats = rng.standard_normal((SIDE, SIDE), dtype=np.float32)
    eights = rng.integers(0, 255, (SIDE, SIDE), dtype=np.uint8)
    fp32 = product_session("MatMul", [TensorProto.FLOAT] * 3, floats, threads)
    int8 = product_session(
        "MatMulInteger",
        [TensorProto.UINT8, TensorProto.INT8, TensorProto.INT32],
        eights.astype(np.int8),
        threads,
    )
    operations = 2.0 * SIDE**3
    # A vector times a matrix far larger than any cache reads the matrix once and does little else.
    rows, columns = 64 * SIDE, 4 * SIDE
    wide = np.ones((columns, rows), np.float32)
    reading = product_session("MatMul", [TensorProto.FLOAT] * 3, wide, threads)
    vector = np.ones((1, columns), np.float32)
    return Machine(
        operations / fastest(lambda: fp32.run(None, {"a": floats})),
        operations / fastest(lambda: int8.run(None, {"a": eights})),
        wide.nbytes / fastest(lambda: reading.run(None, {"a": vector})),
    )


def product_session(
    kind: str, types: list[int], factor: np.ndarray, threads: int
) -> onnxruntime.InferenceSession:
    """ONNX Runtime for `a` times a constant matrix."""
    graph = helper.make_graph(
        [helper.make_node(kind, ["a", "b"], ["c"])],
        "product",
        [helper.make_tensor_value_info("a", types[0], ["n", factor.shape[0]])],
        [helper.make_tensor_value_info("c", types[2], ["n", factor.shape[1]])],
        [onnx.numpy_helper.from_array(factor, "b")],
    )
    opset = [helper.make_opsetid("", 17)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=8)
    return onnxruntime.InferenceSession(
        model.SerializeToString(), session_options(threads), providers=["CPUExecutionProvider"]
    )


def session_options(threads: int) -> onnxruntime.SessionOptions:
    """As `re3.engine.onnx_engine` sets them."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    return options


def fastest(work: Callable[[], object], times: int = 15) -> float:
    """Seconds of the fastest of some runs: what the machine can do, not what it usually does."""
    best = float("inf")
    for _ in range(times):
        started = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - started)
    return best


def show(model: str, machine: Machine, threads: int) -> None:
    """Print the parts of a model against their limits."""
    parts, whole = profile(model, threads)
    parts["crop"] = crop_work(model, threads)
    print(f"\n{model}: one object, a step of {1000 * whole:.2f} ms without the crop")
    print(f"{'part':16} {'MFLOP':>8} {'MB':>7} {'ms':>7} {'limit ms':>9} {'of limit':>9}  bound by")
    total = Work()
    limit_of_all = 0.0
    eight_bits = is_8_bit(model)
    for name in ("crop", *(part for part, _ in PARTS), OTHER):
        if name not in parts:
            continue
        work = parts[name]
        integer = eight_bits and name in eight_bits
        arithmetic = work.operations / (machine.int8 if integer else machine.fp32)
        reading = work.bytes / machine.memory
        limit = max(arithmetic, reading)
        bound = "arithmetic" if arithmetic > reading else "memory"
        print_row(name, work, limit, bound)
        limit_of_all += limit
        total.operations += work.operations
        total.bytes += work.bytes
        total.seconds += work.seconds
    print_row("all", total, limit_of_all, "")


def print_row(name: str, work: Work, limit: float, bound: str) -> None:
    """A line of the table."""
    share = limit / work.seconds if work.seconds else float("nan")
    print(
        f"{name:16} {work.operations / 1e6:8.1f} {work.bytes / 1e6:7.2f} "
        f"{1000 * work.seconds:7.3f} {1000 * limit:9.3f} {share:9.0%}  {bound}"
    )


def profile(model: str, threads: int) -> tuple[dict[str, Work], float]:
    """Work of each part of a step by ONNX Runtime's profile; seconds of the whole without it."""
    from re3.engine import find_file, load_engine, zero_state

    engine = load_engine(find_file(model)[0], "onnx", threads)
    rng = np.random.default_rng(0)
    feeds: dict[str, np.ndarray] = dict(zero_state(engine.spec, 1))
    for name, view in (
        ("previous_crops", engine.spec.previous),
        ("current_crops", engine.spec.current),
    ):
        if view is not None:
            feeds[name] = rng.integers(0, 256, (1, view.size, view.size, 3), dtype=np.uint8)
    state = {name: feeds[name] for name in engine.spec.state}
    # From the second step on nothing is as at the start.
    _, _, state = engine.step(feeds.get("previous_crops"), feeds["current_crops"], state)
    feeds.update(state)
    whole = median(lambda: engine.step(feeds.get("previous_crops"), feeds["current_crops"], state))
    with tempfile.TemporaryDirectory() as folder:
        options = session_options(threads)
        options.enable_profiling = True
        options.profile_file_prefix = str(Path(folder) / "profile")
        session = onnxruntime.InferenceSession(
            str(find_file(model)[0]), options, providers=["CPUExecutionProvider"]
        )
        for _ in range(WARM_UP + STEPS):
            session.run(None, feeds)
        events = json.loads(Path(session.end_profiling()).read_text(encoding="utf-8"))
    runs: dict[str, list[dict]] = defaultdict(list)
    for event in events:
        if event.get("cat") == "Node" and event["name"].endswith("_kernel_time"):
            name = event["name"].removesuffix("_kernel_time").removeprefix("fused ")
            runs[name].append(event)
    kernels = kernel_sizes(model)
    parts = {part: Work(bytes=held) for part, held in weight_bytes(model).items()}
    for name, each in runs.items():
        work = parts.setdefault(part_of(name), Work())
        one = each[-1]["args"]
        work.operations += operations_of(one, kernels.get(name.split("_token_")[0]))
        work.bytes += float(one["activation_size"]) + float(one["output_size"])
        seconds = np.array([event["dur"] for event in each]) / 1e6
        # Some operators run several times a step.
        times = max(1, round(len(each) / (WARM_UP + STEPS)))
        work.seconds += float(np.median(seconds[WARM_UP:])) * times
    return parts, whole


def median(work: Callable[[], object]) -> float:
    """Seconds of the median run."""
    seconds = []
    for _ in range(WARM_UP + STEPS):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return float(np.median(seconds[WARM_UP:]))


def part_of(name: str) -> str:
    """The part that an operator belongs to, by its name."""
    return next((part for part, words in PARTS if any(word in name for word in words)), OTHER)


def kernel_sizes(model: str) -> dict[str, float]:
    """Products for each output value of a convolution, by the name it has in the graph."""
    from re3.engine import find_file

    graph = onnx.load(str(find_file(model)[0])).graph
    stored = {weight.name: weight.dims for weight in graph.initializer}
    for node in graph.node:  # weights behind a cast or a scale
        if node.op_type in ("Cast", "DequantizeLinear") and node.input[0] in stored:
            stored[node.output[0]] = stored[node.input[0]]
    return {
        node.name: float(np.prod(stored[node.input[1]][1:]))
        for node in graph.node
        if node.op_type == "Conv" and node.input[1] in stored
    }


def operations_of(arguments: dict, kernel: float | None = None) -> float:
    """Multiplications and additions of one run of an operator; of small ones one an element.

    Args:
        arguments: what ONNX Runtime's profile says of it.
        kernel: of a convolution that it does not say all of, products for each output value.
    """
    kind = arguments["op_name"]
    shapes = [next(iter(one.values())) for one in arguments["input_type_shape"]]
    out = float(np.prod(next(iter(arguments["output_type_shape"][0].values()))))
    if "Conv" in kind:
        # Weights are [out, in / groups, height, width]; an 8-bit convolution has scales between.
        weights = [shape for shape in shapes[1:] if len(shape) == 4]
        return 2.0 * out * (float(np.prod(weights[0][1:])) if weights else kernel or 0.0)
    if "MatMul" in kind or "Gemm" in kind:
        return 2.0 * out * float(shapes[0][-1])
    return out


def weight_bytes(model: str) -> dict[str, float]:
    """Bytes of each part's weights while it runs: those stored as fp16 are fp32 then."""
    from re3.engine import find_file

    held: dict[str, float] = defaultdict(float)
    for weight in onnx.load(str(find_file(model)[0])).graph.initializer:
        values = onnx.numpy_helper.to_array(weight)
        width = 4 if values.dtype == np.float16 else values.dtype.itemsize
        held[part_of(weight.name)] += float(values.size * width)
    return held


def crop_work(model: str, threads: int) -> Work:
    """Cutting the crops of a step out of a frame of 640 x 480 with an object of 72 x 96."""
    from re3.benchmark.contenders import Entry
    from re3.benchmark.footage import made_footage
    from re3.benchmark.measure import over_rounds, take_turns
    from re3.engine import find_file, load_engine

    timing = take_turns(
        {"model": Entry("model", True, model, threads=threads).make()},
        made_footage(60),
        rounds=3,
        frames=STEPS,
    )["model"]
    spec = load_engine(find_file(model)[0], "onnx", threads).spec
    views = [view for view in (spec.previous, spec.current) if view is not None]
    read = sum(3 * 72 * 96 * view.context**2 for view in views)
    written = sum(3 * view.size**2 for view in views)
    # Linear interpolation: three times two products and a sum for each value.
    return Work(9.0 * written, read + written, over_rounds(timing.crop).p50)


def is_8_bit(model: str) -> set[str]:
    """The parts whose products are of 8 bits."""
    from re3.engine import find_file

    graph = onnx.load(str(find_file(model)[0])).graph
    kinds = ("MatMulInteger", "QLinearConv", "ConvInteger", "QLinearMatMul")
    found = {part_of(node.output[0]) for node in graph.node if node.op_type in kinds}
    quantised = {node.output[0] for node in graph.node if node.op_type == "DequantizeLinear"}
    return found | {
        part_of(node.output[0])
        for node in graph.node
        if node.op_type == "Conv" and node.input[0] in quantised
    }


if __name__ == "__main__":
    # Run from a checkout that is not installed as well.
    sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
    main()
