"""From images and sweeps alone: trains a small network, labels drives that it has not seen, and calibrates them.

python tests/benchmarks/labels_from_images.py -o DIR [--seconds 120] [--drives 4] [--frames 20] [--width 1280]

The network learns from synthetic streets of other seeds, is written as an ONNX file with its card, and `semcal label`
labels the images of each drive. Prints Markdown: how many pixels have the right label, how far each calibration ends
from the truth, by segments and by point labels, from nothing, and how long all that is done before and after a
network takes beside its own time.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import perf_counter

import cv2
import numpy as np
import torch
import yaml
from benchmark import script, seconds_of, street, table
from torch import nn

from semcal_cli import core
from semcal_cli.api.calls import calibrate
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError
from semcal_cli.files.image_files import read_image
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses, pose_from_mounting
from semcal_cli.labelling.image_labeller import ImageLabeller
from semcal_cli.labelling.model import image_model
from semcal_cli.labelling.onnx_network import open_network
from semcal_cli.observations.reading import read_label_images

TRAINING_SEED, DRIVE_SEED = 95_000, 96_000
MEAN, STD = 0.45, 0.25
WIDTHS = (16, 32, 64, 96)
RATE, BATCH = 4e-3, 2
LARGER = 3
"""How much wider a network is that costs about as much as BiSeNetV2, whose authors state 21 GFLOP for 1024 x 512."""
OPSET = 17
ROUNDS = 5


class Network(nn.Module):
    """An encoder of four strides and a decoder back to the second, with scores at a quarter of the image's size."""

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
    count: int, image_size: tuple[int, int], size: tuple[int, int], class_ids: np.ndarray
) -> tuple[torch.Tensor, torch.Tensor]:
    """Images (N, 3, h, w) at the network's size, and dense classes (N, H, W) at the image's.

    Each street is seen by a camera of its own, which looks anywhere, nearly level.
    The images are shrunk as `semcal label` shrinks them.
    """
    width, height = image_size
    lookup = np.zeros(256, np.uint8)
    lookup[class_ids] = np.arange(len(class_ids))
    K = [[width / 2, 0, width / 2 - 0.5], [0, width / 2, height / 2 - 0.5], [0, 0, 1]]
    camera = core.Camera("plumb_bob", width, height, K, [0.0] * 5)
    random = np.random.default_rng(TRAINING_SEED)
    images, labels = [], []
    for number in range(count):
        config = SynthConfig(seed=TRAINING_SEED + number, channels=2, columns=4)
        azimuth_deg, pitch_deg = random.uniform(-180.0, 180.0), random.uniform(-8.0, 8.0)
        mounting = pose_from_mounting((0.0, -pitch_deg, azimuth_deg), (0.0, 0.0, 0.0))
        frame = core.Renderer(camera, mounting, config).frame(config.seed, 0)
        shrunk = cv2.resize(frame.image_rgb, size, interpolation=cv2.INTER_AREA)
        images.append(((shrunk / 255.0 - MEAN) / STD).transpose(2, 0, 1))
        labels.append(lookup[frame.image_labels])
    return torch.from_numpy(np.stack(images)).float(), torch.from_numpy(np.stack(labels))


def train(
    image_size: tuple[int, int], size: tuple[int, int], seconds: float, count: int, class_ids: np.ndarray
) -> Network:
    torch.manual_seed(0)
    images, labels = training_frames(count, image_size, size, class_ids)
    network = Network(len(class_ids)).to(memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-3)
    start, steps = perf_counter(), 0
    while (elapsed := perf_counter() - start) < seconds or steps == 0:
        part = min(elapsed / seconds, 1.0)
        for group in optimizer.param_groups:
            group["lr"] = RATE * min(part / 0.1, 0.5 + 0.5 * float(np.cos(np.pi * part))) + 1e-5
        chosen = torch.randint(count, (BATCH,))
        image = images[chosen].contiguous(memory_format=torch.channels_last)
        image = image * (1.0 + 0.1 * torch.randn(BATCH, 1, 1, 1)) + 0.1 * torch.randn(BATCH, 3, 1, 1)
        is_flipped = bool(torch.rand(()) < 0.5)
        with torch.autocast("cpu", torch.bfloat16):
            scores = network(image.flip(3) if is_flipped else image).float()
        loss = nn.functional.cross_entropy(
            scores.flip(3) if is_flipped else scores, under(labels[chosen], scores)
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        steps += 1
    print(
        f"trained {steps} steps of {BATCH} of {count} images in {elapsed:.0f} s, last loss {loss.item():.2f}",
        file=sys.stderr,
    )
    return network.eval()


def under(labels: torch.Tensor, scores: torch.Tensor) -> torch.Tensor:
    """Classes (N, h, w) of a random place in each cell of the scores: on average, borders are where they are."""
    (height, width), (rows, columns) = labels.shape[1:], scores.shape[2:]
    v = ((torch.arange(rows) + torch.rand(())) * height / rows).long().clamp(max=height - 1)
    u = ((torch.arange(columns) + torch.rand(())) * width / columns).long().clamp(max=width - 1)
    return labels[:, v[:, None], u].long()


def export(network: Network, path: Path, size: tuple[int, int], names: list[str]) -> None:
    """Write the network as ONNX, with its normalisations folded into its convolutions, and its card."""
    image, ends = torch.zeros(1, 3, *size[::-1]), {"input_names": ["image"], "output_names": ["logits"]}
    torch.onnx.export(network, (image,), str(path), **ends, opset_version=OPSET, dynamo=False)
    card = {
        "semcal_image_model": 1,
        "color": "rgb",
        "scale": 1 / 255,
        "mean": [MEAN],
        "std": [STD],
        "kind": "logits",
        "classes": names,
    }
    path.with_suffix(".yaml").write_text(yaml.safe_dump(card, sort_keys=False))


def right_pixels(labelled: Path, truth: Path, class_ids: np.ndarray) -> float:
    lookup = np.full(65_536, 255)
    lookup[class_ids] = np.arange(len(class_ids))
    found = read_label_images(read_drive(labelled))
    needed = [lookup[ids] for ids in read_label_images(read_drive(truth))]
    return float(np.mean([np.mean(a == b) for a, b in zip(found, needed, strict=True)]))


def calibrated(labelled: Path, truth: Path, cue: str) -> tuple[str, tuple[float, float]]:
    """Cell of a calibration by a cue, and its errors in degrees and centimetres."""
    try:
        found = calibrate(labelled, CalibrationConfig(cues=(cue,)))
    except CalibrationError as reason:
        print(reason, file=sys.stderr)
        return "no answer", (math.inf, math.inf)
    error = compare_poses(found.pose, read_transform(truth / "drive.yaml"))
    errors = error.rotation_deg, error.camera_center_cm
    return "{:.3f} deg, {:.2f} cm, {}".format(*errors, found.status), errors


def times(name: str, model: Path, drive: Path) -> tuple[str, ...]:
    """Row of the network's own time, and of all that is done before and after it, for an image: medians."""
    document = read_drive(drive)
    opened = image_model(open_network(model), None)
    labeller = ImageLabeller(opened, document.camera)
    own, whole = [], []
    image = read_image(document.resolve(str(document.frames[0].image)))
    for _ in range(ROUNDS + 1):
        start = perf_counter()
        labeller.ids(image)
        whole.append(perf_counter() - start)
        tensors = {opened.network.input.name: labeller.tensor(labeller.views.draws[0](image))}
        start = perf_counter()
        opened.network.run(tensors, opened.outputs)
        own.append(perf_counter() - start)
    # The first round plans the places of pixels.
    network, rest = median(own[1:]), median(whole[1:]) - median(own[1:])
    return name, f"{1e3 * network:.1f}", f"{1e3 * rest:.1f}", f"{rest / network:.2f}"


def main(
    *,
    output: Path,
    seconds: float = 120.0,
    training_frames: int = 60,
    drives: int = 4,
    frames: int = 20,
    width: int = 1280,
) -> Iterator[str]:
    """Train for so many seconds, label, calibrate, and time."""
    size = (width // 32 * 16, -(-(width * 9 // 16) // 32) * 16)
    classes = core.synthetic_classes()
    class_ids, names = np.array([value for value, _ in classes]), [name for _, name in classes]
    output.mkdir(parents=True, exist_ok=True)
    model, large = output / "network.onnx", output / "large.onnx"
    small = train((width, width * 9 // 16), size, seconds, training_frames, class_ids)
    wide = Network(len(names), tuple(LARGER * width for width in WIDTHS)).eval()
    for network, path in ((small, model), (wide, large)):
        export(network, path, size, names)

    def rows() -> Iterator[tuple[str, ...]]:
        errors = []
        for number in range(drives):
            truth, labelled = (output / f"{kind}_{number}" for kind in ("drive", "labelled"))
            street(truth, DRIVE_SEED + number, frames, width)
            seconds_of("label", truth, "--image-model", model, "-o", labelled)
            right = right_pixels(labelled, truth, class_ids)
            cells, found = zip(
                *(calibrated(labelled, truth, cue) for cue in ("segments", "labels")), strict=True
            )
            errors.append(found)
            yield str(number), f"{right:.1%}", *cells
        yield "worst", "", *(f"{deg:.3f} deg, {cm:.2f} cm" for deg, cm in np.max(errors, axis=0))

    yield from table("drive | right pixels | by segments | by point labels", rows())
    yield ""
    timed = {"the one above": model, f"{LARGER} times as wide": large}
    found = (times(name, path, output / "drive_0") for name, path in timed.items())
    yield from table("network | its own time, ms | all else, ms | ratio", found)


if __name__ == "__main__":
    script(main)
