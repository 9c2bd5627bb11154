"""The one-step graph for runtimes other than ONNX Runtime: TorchScript and OpenVINO."""

from __future__ import annotations

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from re3.model_spec import SPEC_KEY
from re3.network.export import OPSET, Change, OneStep, example_inputs, export_onnx
from re3.network.variants import Network


def export_torchscript(network: Network, path: Path) -> None:
    """Write a traced module; inputs and outputs in the order of `OneStep`.

    The description of the model is in the file as well, under `re3_spec`.

    Args:
        network: exported in evaluation mode.
        path: of the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    training = network.training
    network.eval()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # of the tracer, about shapes that are constant here
        traced = torch.jit.trace(
            OneStep(network), tuple(example_inputs(network).values()), check_trace=False
        )
        torch.jit.save(traced, str(path), _extra_files={SPEC_KEY: network.spec().to_json()})
    network.train(training)


def export_openvino(
    network: Network, path: Path, *, opset: int = OPSET, change: Change | None = None
) -> None:
    """Write OpenVINO's .xml and, beside it, .bin with the weights as fp16.

    Inputs and outputs have the names of the ONNX graph; the description of the model is in the
    file as well, as runtime information `re3_spec`.

    Args:
        network: exported in evaluation mode.
        path: of the .xml file.
        opset, change: of the ONNX graph in between, see `export_onnx`.

    Raises:
        ImportError: OpenVINO is not installed.
        ValueError: as `export_onnx`.
    """
    import openvino

    path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        between = Path(folder) / "model.onnx"
        export_onnx(network, between, half_weights=False, opset=opset, change=change)
        model = openvino.convert_model(between)
        model.set_rt_info(network.spec().to_json(), [SPEC_KEY])
        openvino.save_model(model, path, compress_to_fp16=change is None)
