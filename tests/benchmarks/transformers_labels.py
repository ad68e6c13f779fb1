"""Labels of semcal compared with those of transformers, pixel by pixel, for each architecture that semcal supports.

python tests/benchmarks/transformers_labels.py [--width 1024] [--only NAME]

Needs transformers, torchvision, timm and onnxscript. Each network is tiny and has random weights, so that nothing is
downloaded and there are many borders between classes. It is exported by torch.onnx with transformers' files beside it.
One image of a synthetic street is labelled by transformers (its processor, the network in PyTorch, its post-processing)
and by semcal (the ONNX file and these files). Prints Markdown: the share of pixels with the same label, among all
pixels and away from borders, the number of classes seen, or why a network could not be compared.
"""

from __future__ import annotations

import inspect
import logging
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import torch
import transformers
from benchmark import script, street, table

from semcal_cli.drive.camera import Camera
from semcal_cli.labelling.image_labeller import ImageLabeller
from semcal_cli.labelling.model import image_model
from semcal_cli.labelling.onnx_network import open_network
from semcal_cli.observations.reading import read_needed_image

SEED = 7
GAIN, SPREAD = 1.4, 4.0
"""Gain of the weights that preserves the spread of their input, and standard deviation of embeddings."""
NUM_CLASSES = 8
STEEP = 4.0
"""Standard deviation of scores."""
TASK_IDS = (49406, 518, 10549, 533, 29119, 1550, 49407) + (0,) * 70
TASK = torch.tensor([TASK_IDS])
PADDED = 288
"""Side of a padded image."""
SEEN = 0.01
"""Smallest share of pixels of a class that counts as seen."""
BORDER_PX = 3
"""Distance from a border between classes within which a pixel counts as beside it."""
LABELS = {index: f"class {index}" for index in range(NUM_CLASSES)}
SWIN = {
    "embed_dim": 24,
    "depths": [1, 1, 1, 1],
    "num_heads": [2, 2, 2, 2],
    "window_size": 4,
    "out_features": ["stage1", "stage2", "stage3", "stage4"],
}
VIT = {"hidden_size": 48, "num_hidden_layers": 4, "num_attention_heads": 4}
DECODER = {
    "hidden_dim": 32,
    "encoder_layers": 1,
    "encoder_feedforward_dim": 64,
    "decoder_layers": 2,
    "dim_feedforward": 64,
    "num_attention_heads": 2,
    "num_queries": 20,
}
SQUARE = {"height": 256, "width": 256}
EDGES = {"shortest_edge": 288, "longest_edge": 800}
"""Sizes to which processors bring an image."""
OUTPUTS = ("class_queries_logits", "masks_queries_logits")
"""Outputs of networks with queries; the others have `logits`."""

Network = tuple[Any, Any]
"""A transformers network and its image processor."""


def network(name: str, processor: Any, **config: Any) -> Network:
    """Make a network by its name in transformers, with the names of the classes in its configuration."""
    made = getattr(transformers, f"{name.rpartition('For')[0]}Config")(**config, id2label=LABELS)
    return getattr(transformers, name)(made), processor


def segformer() -> Network:
    processor = transformers.SegformerImageProcessorPil(size=SQUARE)
    config = {"hidden_sizes": [16, 32, 48, 64], "depths": [1] * 4, "decoder_hidden_size": 32}
    return network("SegformerForSemanticSegmentation", processor, **config)


def upernet() -> Network:
    processor = transformers.SegformerImageProcessorPil(size=SQUARE)
    config = {"backbone_config": transformers.SwinConfig(**SWIN), "hidden_size": 32}
    return network("UperNetForSemanticSegmentation", processor, **config, use_auxiliary_head=False)


def dpt() -> Network:
    return network(
        "DPTForSemanticSegmentation",
        transformers.DPTImageProcessorPil(size=SQUARE, resample=3),
        **VIT,
        intermediate_size=96,
        image_size=256,
        neck_hidden_sizes=[16, 24, 32, 32],
        fusion_hidden_size=32,
        backbone_out_indices=[0, 1, 2, 3],
        use_auxiliary_head=False,
    )


def mobilevit() -> Network:
    return network(
        "MobileViTForSemanticSegmentation",
        # Without its centre crop: semcal labels whole images.
        transformers.MobileViTImageProcessorPil(size={"shortest_edge": 288}, do_center_crop=False),
        image_size=256,
        hidden_sizes=[24, 32, 40],
        neck_hidden_sizes=[8, 16, 24, 24, 32, 40, 64],
        aspp_out_channels=32,
        num_attention_heads=4,
    )


def maskformer() -> Network:
    detr = {"d_model": 32, "decoder_layers": 1, "decoder_attention_heads": 2, "decoder_ffn_dim": 64}
    return network(
        "MaskFormerForInstanceSegmentation",
        transformers.MaskFormerImageProcessorPil(size=EDGES),
        fpn_feature_size=32,
        mask_feature_size=32,
        backbone_config=transformers.SwinConfig(**SWIN),
        decoder_config=transformers.DetrConfig(**detr, num_queries=20),
    )


def mask2former() -> Network:
    processor = transformers.Mask2FormerImageProcessorPil(size=EDGES)
    config = {"backbone_config": transformers.SwinConfig(**SWIN), "feature_size": 32, "mask_feature_size": 32}
    return network("Mask2FormerForUniversalSegmentation", processor, **config, **DECODER)


def oneformer() -> Network:
    return network(
        "OneFormerForUniversalSegmentation",
        transformers.OneFormerImageProcessorPil(size=EDGES, num_text=1, class_info_file=None),
        backbone_config=transformers.SwinConfig(**SWIN),
        conv_dim=32,
        mask_dim=32,
        **DECODER,
        task_seq_len=77,
        text_encoder_width=32,
        text_encoder_num_layers=1,
        query_dec_layers=1,
        is_training=False,
    )


def eomt(name: str = "Eomt", **more: int) -> Network:
    """EoMT for semantic segmentation, whose processor cuts an image into squares."""
    size = {"shortest_edge": 288, "longest_edge": None}
    processor = transformers.EomtImageProcessorPil(size=size, do_split_image=True, do_pad=False)
    config = {"image_size": 288, "patch_size": 16, "num_blocks": 1, "num_queries": 20}
    return network(f"{name}ForUniversalSegmentation", processor, **VIT, **config, **more)


def padded_eomt() -> Network:
    """EoMT for panoptic segmentation, whose processor pads an image to a square."""
    size = {"shortest_edge": PADDED, "longest_edge": PADDED}
    processor = transformers.EomtImageProcessorPil(size=size, do_split_image=False, do_pad=True)
    config = {"image_size": PADDED, "patch_size": 16, "num_blocks": 1, "num_queries": 20}
    return network("EomtForUniversalSegmentation", processor, **VIT, **config)


OVERLAP = "EoMT, an image of 16 to 9"
"""The row whose windows overlap; other rows have an image of 2 to 1."""
NETWORKS: dict[str, Callable[[], Network]] = {
    "SegFormer": segformer,
    "UperNet": upernet,
    "DPT": dpt,
    "MobileViT": mobilevit,
    "MaskFormer": maskformer,
    "Mask2Former": mask2former,
    "OneFormer": oneformer,
    "EoMT": eomt,
    "EoMT of DINOv3": partial(eomt, "EomtDinov3", intermediate_size=96),
    OVERLAP: eomt,
    "EoMT, padded, as trained on COCO": padded_eomt,
}


class Outputs(torch.nn.Module):
    """A network with a tuple of outputs, as an ONNX file has, each with the spread of a trained network."""

    def __init__(self, network: Any, pixels: torch.Tensor) -> None:
        super().__init__()
        self.network = network
        self.names = ("logits",) if "Semantic" in type(network).__name__ else OUTPUTS
        self.num_inputs = 1 + ("task_inputs" in inspect.signature(network.forward).parameters)
        self.moments: list[tuple[torch.Tensor, torch.Tensor]] = []
        # For each class over the pixels or the queries, and for each query over the pixels.
        axes = [(0, 2, 3) if found.ndim == 4 else (0, 1) for found in self(pixels, TASK)]
        self.moments = [
            (found.mean(axis, keepdim=True), found.std(axis, keepdim=True) / STEEP)
            for found, axis in zip(self(pixels, TASK), axes, strict=True)
        ]

    def forward(self, *inputs: torch.Tensor) -> tuple[torch.Tensor, ...]:
        found = self.network(*inputs[: self.num_inputs], return_dict=True)
        outputs = tuple(found[name] for name in self.names)
        if not self.moments:
            return outputs
        return tuple((each - mean) / std for each, (mean, std) in zip(outputs, self.moments, strict=True))


def randomise(network: Any) -> None:
    """Give each layer weights that preserve the spread of its input, and random biases."""
    for name, parameter in network.named_parameters():
        if parameter.ndim > 1:
            torch.nn.init.normal_(parameter, 0.0, GAIN * parameter[0].numel() ** -0.5)
        elif name.endswith("bias"):
            torch.nn.init.normal_(parameter, 0.0, 0.1)
    for module in network.modules():
        if isinstance(module, torch.nn.Embedding):
            torch.nn.init.normal_(module.weight, 0.0, SPREAD)
    if hasattr(network, "attn_mask_probs"):
        # EoMT branches on these numbers, which are 0 at the end of training; an export cannot branch.
        delattr(network, "attn_mask_probs")
        network.attn_mask_probs = [0.0] * network.config.num_blocks
    network.eval()


def main(*, width: int = 1024, only: str = "") -> Iterator[str]:
    for name in ("torch.onnx", "transformers", "onnxscript", "onnx_ir"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.simplefilter("ignore")
    transformers.logging.disable_progress_bar()
    with tempfile.TemporaryDirectory() as folder:
        drive, _ = street(Path(folder) / "drive", SEED, 1, width)
        whole = read_needed_image(drive, drive.frames[0])
        yield from table(
            "architecture | same label | same, away from borders | classes seen",
            (
                compared(name, make, whole if name == OVERLAP else whole[: width // 2], Path(folder) / name)
                for name, make in NETWORKS.items()
                if only.lower() in name.lower()
            ),
        )
    yield ""
    yield f"transformers {transformers.__version__}, an image {width} pixels wide."


def compared(name: str, make: Callable[[], Network], image: np.ndarray, folder: Path) -> tuple[str, ...]:
    """Make the row of a network, or say why it cannot be compared."""
    torch.manual_seed(SEED)
    folder.mkdir()
    network, processor = make()
    randomise(network)
    inputs = processor(images=np.ascontiguousarray(image[..., ::-1]), return_tensors="pt")
    with torch.no_grad():
        outputs = Outputs(network, inputs["pixel_values"])
        expected = theirs(outputs, processor, inputs, image.shape[:2])
    try:
        export(outputs, processor, inputs["pixel_values"][:1], folder)
        found = ours(folder / "model.onnx", image)
    except Exception as error:
        reason = " ".join(str(error).split())[:160]
        return name, f"not compared: {reason}", "", ""
    same = found == expected
    labels = expected.astype(np.float32)
    kernel = np.ones((2 * BORDER_PX + 1,) * 2)
    inner = cv2.erode(labels, kernel) == cv2.dilate(labels, kernel)
    shares = np.bincount(expected.ravel(), minlength=NUM_CLASSES) / expected.size
    return name, f"{same.mean():.2%}", f"{same[inner].mean():.2%}", str((shares >= SEEN).sum())


def theirs(outputs: Outputs, processor: Any, inputs: Any, size: tuple[int, int]) -> np.ndarray:
    """Label an image of this size with transformers: classes (H, W)."""
    found = outputs(inputs["pixel_values"], TASK)
    fields = SimpleNamespace(**dict(zip(outputs.names, found, strict=True)))
    fields.patch_offsets = inputs.get("patch_offsets")
    if getattr(processor, "do_pad", False) and hasattr(processor, "unpad_image"):
        # The semantic post-processing would stretch the padding over the image; the panoptic one leaves it out.
        masks = torch.nn.functional.interpolate(
            fields.masks_queries_logits, (PADDED, PADDED), mode="bilinear"
        )
        classes = fields.class_queries_logits.softmax(-1)[..., :-1]
        scores = torch.einsum("bqc,bqhw->bchw", classes, masks.sigmoid())
        return np.asarray(processor.unpad_image(scores, [size], processor.size)[0].argmax(0))
    (labels,) = processor.post_process_semantic_segmentation(fields, target_sizes=[size])
    return np.asarray(labels)


@torch.no_grad()
def export(outputs: Outputs, processor: Any, pixels: torch.Tensor, folder: Path) -> None:
    """Export the network, with the transformers files beside it."""
    module = sys.modules[type(outputs.network).__module__]
    if hasattr(module, "torch_compilable_check"):
        # ONNX cannot express the shape checks in the decoder of OneFormer.
        module.torch_compilable_check = lambda *_: None  # type: ignore[attr-defined]
    torch.onnx.export(
        outputs,
        (pixels, TASK)[: outputs.num_inputs],
        folder / "model.onnx",
        input_names=["pixel_values", "task_inputs"][: outputs.num_inputs],
        output_names=list(outputs.names),
        dynamo=True,
        verbose=False,
    )
    outputs.network.config.architectures = [type(outputs.network).__name__]
    outputs.network.config.save_pretrained(folder)
    processor.save_pretrained(folder)


def ours(path: Path, image: np.ndarray) -> np.ndarray:
    """Label an image with semcal."""
    height, width = image.shape[:2]
    K = ((1.0 * width, 0.0, width / 2.0), (0.0, 1.0 * width, height / 2.0), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    return ImageLabeller(image_model(open_network(path), None), camera).ids(image)


if __name__ == "__main__":
    script(main)
