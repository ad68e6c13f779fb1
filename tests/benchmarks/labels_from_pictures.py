"""From pictures and sweeps alone: trains a small network, labels drives that it has not seen, and calibrates them.

python tests/benchmarks/labels_from_pictures.py -o DIR [--seconds 120] [--drives 4] [--frames 20] [--width 1280]

The network learns from synthetic streets of other seeds, is written as an ONNX file with its card, and `semcal label`
labels the pictures of each drive. Prints Markdown: how many pixels have the right label, how far each calibration ends
from the truth, by segments and by labels of points, from nothing, and how long all that is done before and after a
network takes beside its own time.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import perf_counter

import cv2
import numpy as np
import onnx
import torch
import yaml
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from semcal_cli import _core
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.reading import read_label_images
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.speed import SEMCAL
from semcal_cli.files.images import read_image
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.labelling.model import picture_model
from semcal_cli.labelling.network import open_network
from semcal_cli.labelling.pictures import PictureLabeller
from semcal_cli.pipeline import calibrate
from semcal_cli.synthetic.synthesis import synthesize

TRAINING_SEED, DRIVE_SEED = 95_000, 96_000
MEAN, STD = 0.45, 0.25
WIDTHS = (16, 32, 64, 96)
RATE, BATCH = 4e-3, 2
LARGER = 3
"""How much wider a network is that costs about as much as BiSeNetV2, whose authors state 21 GFLOP for 1024 x 512."""
TRAINING_FRAMES = 60
OPSET, IR_VERSION = 17, 9
ROUNDS = 5


class Network(nn.Module):
    """An encoder of four strides and a decoder back to the second, with scores at a quarter of the picture's size."""

    def __init__(self, num_classes: int, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        sizes = (3, *widths)
        self.down = nn.ModuleList(block(before, after, stride=2) for before, after in pairwise(sizes))
        self.middle = nn.ModuleList(block(widths[-1], widths[-1], dilation=each) for each in (1, 2, 4))
        self.up = nn.ModuleList(
            block(widths[place] + widths[place - 1], widths[place - 1]) for place in (3, 2, 1)
        )
        self.scores = nn.Conv2d(widths[0], num_classes, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        seen = []
        for layer in self.down:
            x = layer(x)
            seen.append(x)
        for layer in self.middle:
            x = x + layer(x)
        for layer, beside in zip(self.up, seen[-2::-1], strict=True):
            x = nn.functional.interpolate(x, scale_factor=2.0, mode="nearest")
            x = layer(torch.cat([x, beside], 1))
        return self.scores(x)


def block(before: int, after: int, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, 3, stride, dilation, dilation, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(after), nn.ReLU())


def training_frames(
    count: int, picture_size: tuple[int, int], size: tuple[int, int], class_ids: np.ndarray
) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures (N, 3, h, w) at the network's size, and dense classes (N, H, W) at the picture's.

    Each street is seen by a camera of its own. The pictures are shrunk as `semcal label` shrinks them.
    """
    width, height = picture_size
    lookup = np.zeros(256, np.uint8)
    lookup[class_ids] = np.arange(len(class_ids))
    K = [[width / 2, 0, width / 2 - 0.5], [0, width / 2, height / 2 - 0.5], [0, 0, 1]]
    camera = _core.Camera("plumb_bob", width, height, K, [0.0] * 5)
    random = np.random.default_rng(TRAINING_SEED)
    pictures, labels = [], []
    for number in range(count):
        config = SynthConfig(seed=TRAINING_SEED + number, channels=2, columns=4)
        frame = _core.Renderer(camera, mounted(random), config).frame(config.seed, 0)
        shrunk = cv2.resize(frame.image_rgb, size, interpolation=cv2.INTER_AREA)
        pictures.append(((shrunk / 255.0 - MEAN) / STD).transpose(2, 0, 1))
        labels.append(lookup[frame.image_labels])
    return torch.from_numpy(np.stack(pictures)).float(), torch.from_numpy(np.stack(labels))


def mounted(random: np.random.Generator) -> np.ndarray:
    """T_camera_lidar of a camera that looks anywhere around, nearly level."""
    azimuth, pitch = random.uniform(-np.pi, np.pi), np.radians(random.uniform(-8, 8))
    forward = np.array([np.cos(azimuth) * np.cos(pitch), np.sin(azimuth) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    return T


def train(
    picture_size: tuple[int, int], size: tuple[int, int], seconds: float, count: int, class_ids: np.ndarray
) -> Network:
    torch.manual_seed(0)
    pictures, labels = training_frames(count, picture_size, size, class_ids)
    network = Network(len(class_ids)).to(memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-3)
    start, steps = perf_counter(), 0
    while (elapsed := perf_counter() - start) < seconds or steps == 0:
        part = min(elapsed / seconds, 1.0)
        for group in optimizer.param_groups:
            group["lr"] = RATE * min(part / 0.1, 0.5 + 0.5 * float(np.cos(np.pi * part))) + 1e-5
        chosen = torch.randint(count, (BATCH,))
        picture = pictures[chosen].contiguous(memory_format=torch.channels_last)
        picture = picture * (1.0 + 0.1 * torch.randn(BATCH, 1, 1, 1)) + 0.1 * torch.randn(BATCH, 3, 1, 1)
        is_flipped = bool(torch.rand(()) < 0.5)
        with torch.autocast("cpu", torch.bfloat16):
            scores = network(picture.flip(3) if is_flipped else picture).float()
        loss = nn.functional.cross_entropy(
            scores.flip(3) if is_flipped else scores, under(labels[chosen], scores)
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        steps += 1
    print(
        f"trained {steps} steps of {BATCH} of {count} pictures in {elapsed:.0f} s, last loss {loss.item():.2f}",
        file=sys.stderr,
    )
    return network.eval()


def under(labels: torch.Tensor, scores: torch.Tensor) -> torch.Tensor:
    """Classes (N, h, w) of a random place in each cell of the scores: on average, borders are where they are."""
    (height, width), (rows, columns) = labels.shape[1:], scores.shape[2:]
    v = ((torch.arange(rows) + torch.rand(())) * height / rows).long().clamp(max=height - 1)
    u = ((torch.arange(columns) + torch.rand(())) * width / columns).long().clamp(max=width - 1)
    return labels[:, v[:, None], u].long()


def export(network: Network, path: Path, size: tuple[int, int]) -> None:
    """Write the network as ONNX, with its normalisations folded into its convolutions."""
    nodes: list[onnx.NodeProto] = []
    constants: list[onnx.TensorProto] = []

    def constant(array: np.ndarray) -> str:
        constants.append(numpy_helper.from_array(array, f"c{len(constants)}"))
        return constants[-1].name

    def add(kind: str, inputs: list[str], **attributes: object) -> str:
        nodes.append(helper.make_node(kind, inputs, [f"n{len(nodes)}"], **attributes))
        return nodes[-1].output[0]

    def convolved(layer: nn.Sequential, x: str) -> str:
        convolution, norm, _ = layer
        gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        weights = (convolution.weight * gain[:, None, None, None]).detach().numpy()
        bias = (norm.bias - norm.running_mean * gain).detach().numpy()
        (dilation, _), (stride, _) = convolution.dilation, convolution.stride
        settings = {"pads": [dilation] * 4, "strides": [stride] * 2, "dilations": [dilation] * 2}
        return add("Relu", [add("Conv", [x, constant(weights), constant(bias)], **settings)])

    x, seen = "picture", []
    for layer in network.down:
        x = convolved(layer, x)
        seen.append(x)
    for layer in network.middle:
        x = add("Add", [x, convolved(layer, x)])
    for layer, beside in zip(network.up, seen[-2::-1], strict=True):
        scales = constant(np.array([1, 1, 2, 2], np.float32))
        x = add(
            "Resize",
            [x, "", scales],
            mode="nearest",
            coordinate_transformation_mode="asymmetric",
            nearest_mode="floor",
        )
        x = convolved(layer, add("Concat", [x, beside], axis=1))
    weights, bias = (each.detach().numpy() for each in (network.scores.weight, network.scores.bias))
    nodes.append(helper.make_node("Conv", [x, constant(weights), constant(bias)], ["logits"]))
    (width, height), number = size, len(bias)
    graph = helper.make_graph(
        nodes,
        "network",
        [helper.make_tensor_value_info("picture", TensorProto.FLOAT, [1, 3, height, width])],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [1, number, height // 2, width // 2])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = IR_VERSION
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def write_card(path: Path, names: list[str]) -> None:
    card = {
        "semcal_picture_model": 1,
        "color": "rgb",
        "scale": 1 / 255,
        "mean": [MEAN],
        "std": [STD],
        "kind": "logits",
        "classes": names,
    }
    path.write_text(yaml.safe_dump(card, sort_keys=False))


def right_pixels(labelled: Path, truth: Path, class_ids: np.ndarray) -> float:
    lookup = np.full(65_536, 255)
    lookup[class_ids] = np.arange(len(class_ids))
    found = read_label_images(read_drive(labelled))
    needed = [lookup[ids] for ids in read_label_images(read_drive(truth))]
    return float(np.mean([np.mean(a == b) for a, b in zip(found, needed, strict=True)]))


def row(number: int, labelled: Path, truth: Path, right: float) -> tuple[str, list[tuple[float, float]]]:
    cells, errors = [], []
    for cue in ("segments", "labels"):
        try:
            found = calibrate(labelled, CalibrationConfig(cues=(cue,)))
        except CalibrationError as reason:
            print(reason, file=sys.stderr)
            errors.append((math.inf, math.inf))
            cells.append("no answer")
            continue
        error = compare_poses(np.array(found.T_camera_lidar), read_transform(truth / "drive.yaml"))
        errors.append((error.rotation_deg, error.camera_center_cm))
        cells.append(f"{error.rotation_deg:.3f} deg, {error.camera_center_cm:.2f} cm, {found.status}")
    return f"| {number} | {right:.1%} | {' | '.join(cells)} |", errors


def times(name: str, model: Path, drive: Path) -> str:
    """Row of the network's own time, and of all that is done before and after it, for a picture: medians."""
    document = read_drive(drive)
    opened = picture_model(open_network(model), None)
    labeller = PictureLabeller(opened, document.camera)
    own, whole = [], []
    picture = read_image(document.resolve(str(document.frames[0].image)))
    for _ in range(ROUNDS + 1):
        start = perf_counter()
        labeller.ids(picture)
        whole.append(perf_counter() - start)
        tensor = labeller.tensor(labeller.views.draws[0](picture))
        start = perf_counter()
        opened.network.run(tensor, opened.outputs)
        own.append(perf_counter() - start)
    # The first round plans the places of pixels.
    network, rest = median(own[1:]), median(whole[1:]) - median(own[1:])
    return f"| {name} | {1e3 * network:.1f} | {1e3 * rest:.1f} | {rest / network:.2f} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--training-frames", type=int, default=TRAINING_FRAMES)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--width", type=int, default=1280)
    asked = parser.parse_args()
    width, height = asked.width, asked.width * 9 // 16
    size = (width // 32 * 16, -(-height // 32) * 16)
    classes = _core.synthetic_classes()
    class_ids, names = np.array([value for value, _ in classes]), [name for _, name in classes]
    asked.output.mkdir(parents=True, exist_ok=True)
    model = asked.output / "network.onnx"
    export(train((width, height), size, asked.seconds, asked.training_frames, class_ids), model, size)
    write_card(model.with_suffix(".yaml"), names)
    print("| drive | right pixels | by segments | by labels of points |", "|---|---|---|---|", sep="\n")
    errors = []
    for number in range(asked.drives):
        truth, labelled = (asked.output / f"{kind}_{number}" for kind in ("drive", "labelled"))
        synthesize(
            SynthConfig(seed=DRIVE_SEED + number, num_frames=asked.frames, width=width, height=height), truth
        )
        subprocess.run(
            [*SEMCAL, "label", str(truth), "--image-model", str(model), "-o", str(labelled), "-q"], check=True
        )
        text, found = row(number, labelled, truth, right_pixels(labelled, truth, class_ids))
        print(text, flush=True)
        errors.append(found)
    worst = np.max(errors, axis=0)
    cells = " | ".join(f"{deg:.3f} deg, {cm:.2f} cm" for deg, cm in worst)
    print(f"| worst | | {cells} |")
    large = asked.output / "large.onnx"
    export(Network(len(names), tuple(LARGER * width for width in WIDTHS)).eval(), large, size)
    write_card(large.with_suffix(".yaml"), names)
    print("", "| network | its own time, ms | all else, ms | ratio |", "|---|---|---|---|", sep="\n")
    for name, path in (("the one above", model), (f"{LARGER} times as wide", large)):
        print(times(name, path, asked.output / "drive_0"))


if __name__ == "__main__":
    run_script(main)
