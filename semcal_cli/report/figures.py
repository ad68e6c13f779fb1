"""Figures of a report: agreement of classes, information around the pose, and the offsets of single frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.estimation.adjust.frame_offsets import FrameOffsets
from semcal_cli.estimation.adjust.priors import EXACT
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import pose_at
from semcal_cli.observations.observations import Observations
from semcal_cli.report.drawing import (
    ACCENT,
    AXIS_COLORS,
    BAD,
    SOFT,
    Plot,
    draw_intervals,
    name_places,
    page_svg,
    short_names,
)
from semcal_cli.report.points import View, pmi_ratio
from semcal_cli.result.uncertainty import AXIS_NAMES, Uncertainty

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUM_PIXEL_CLASSES = 3
"""Number of pixel classes that are named for each class of points."""

SPANS = (0.1,) * 3 + (0.5,) * 3
"""Minimum reach of the curves to either side of the pose, metres and degrees."""
SPAN_SIGMAS = 4.0
"""Minimum reach of a curve to either side of the pose, in standard errors."""
NUM_SAMPLES = 13
"""Number of samples over the whole curve."""
NUM_NEAR, NEAR_SIGMAS = 5, 2.0
"""Number of samples near the pose, and the standard errors that they span to either side of it."""

SIZE, FRAMES_SIZE = (320.0, 200.0), (640.0, 220.0)
HEADROOM = 0.08
MIN_BAND = 0.003
"""Minimum half width of the drawn interval, relative to the reach of the curve, so that it can be seen."""
MAX_SPANS = 50.0, 5.0
"""Largest offset that is drawn, centimetres and degrees; larger ones are drawn at the edge."""
MIN_SPAN = 1e-3
MAX_BAR_DISTANCE = 0.22, 0.01
"""Largest distance between the bars of two axes, relative to the width of one frame and of all frames."""


@dataclass(frozen=True)
class ClassAgreement:
    """The visible points of one class, and how well they agree with the pixels that they project onto."""

    name: str
    share: float
    """Share of the class in all pairs of a visible point and a pixel that it projects onto."""
    agreeing: float
    """Share of the class's pairs that are found more often than by chance: positive pointwise mutual information."""
    agreeing_before: float | None
    """The same share at the other pose, measured by the pairs there; None without another pose."""
    nats: float
    """Contribution of the class to the mutual information, in nats."""
    lands_on: list[tuple[str, float]]
    """Classes of pixels, with their shares in the class's pairs, largest first."""


def class_agreements(
    observations: Observations, agreement: core.Agreement, before: core.Agreement | None
) -> list[ClassAgreement]:
    """Describe each class of points that the camera sees, the most frequent first."""
    joint = agreement.joint
    total = max(joint.sum(), 1.0)
    shares, agreeing = joint.sum(axis=1) / total, _agreeing_shares(joint)
    agreeing_before = None if before is None else _agreeing_shares(before.joint)
    # A pair that was never seen adds nothing.
    nats = (joint * np.log(np.where(joint > 0.0, pmi_ratio(joint), 1.0))).sum(axis=1) / total
    agreements = []
    for index in np.argsort(-shares, kind="stable").tolist():
        if shares[index] == 0.0:
            continue
        row = joint[index] / joint[index].sum()
        largest = np.argsort(-row, kind="stable")[:NUM_PIXEL_CLASSES].tolist()
        agreements.append(
            ClassAgreement(
                name=observations.point_class_names[index],
                share=float(shares[index]),
                agreeing=float(agreeing[index]),
                agreeing_before=None if agreeing_before is None else float(agreeing_before[index]),
                nats=float(nats[index]),
                lands_on=[(observations.image_class_names[i], float(row[i])) for i in largest if row[i] > 0],
            )
        )
    return agreements


def _agreeing_shares(joint: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    totals = joint.sum(axis=1)
    above = np.where(pmi_ratio(joint) > 1.0, joint, 0.0).sum(axis=1)
    return np.asarray(above / np.where(totals > 0.0, totals, 1.0))


@dataclass(frozen=True)
class Curve:
    """Mutual information along one axis of the camera, with the other axes fixed."""

    name: str
    unit: str
    offsets: npt.NDArray[np.float64]
    """(n,) offsets from the pose, in centimetres or degrees."""
    nats: npt.NDArray[np.float64]
    """(n,) mutual information at the offsets, in nats."""
    sigma: float | None
    """Standard error of the pose along the axis, in the unit of the offsets; None if it is not known."""

    @property
    def optimum(self) -> float:
        """Offset at which the mutual information is largest."""
        return float(self.offsets[self.nats.argmax()])


def information_curves(
    observations: Observations, T_camera_lidar: Pose, uncertainty: Uncertainty | None
) -> list[Curve]:
    """Compute the mutual information of the points visible at a pose along the six axes of the camera.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose in the middle of the curves.
        uncertainty: Uncertainty of the pose, if it is known.
    """
    sigmas: list[float | None] = [None] * 6
    if uncertainty is not None:
        sigmas = [*uncertainty.sigma_camera_center_m, *uncertainty.sigma_rotation_deg]
    offsets = [_offsets(span, sigma) for span, sigma in zip(SPANS, sigmas, strict=True)]
    # The camera's centre moves by a metre against the translation of a twist, or the camera turns by a degree.
    twists = np.diag([-1.0] * 3 + [math.radians(1.0)] * 3).tolist()
    lines = [(twist, axis_offsets.tolist()) for twist, axis_offsets in zip(twists, offsets, strict=True)]
    nats = core.information_along(observations.of_classes.core, T_camera_lidar, lines)
    curves = []
    for axis, (name, sigma) in enumerate(zip(AXIS_NAMES, sigmas, strict=True)):
        scale, unit = (100.0, "cm") if axis < 3 else (1.0, "deg")
        scaled = None if sigma is None else scale * sigma
        curves.append(Curve(name, unit, scale * offsets[axis], np.array(nats[axis]), scaled))
    return curves


def _offsets(min_span: float, sigma: float | None) -> npt.NDArray[np.float64]:
    """Return the offsets (n,) of samples along an axis, metres or degrees: evenly spaced, and denser near the pose."""
    span = max(min_span, SPAN_SIGMAS * (sigma or 0.0))
    # An axis that is practically exact has no scale of its own.
    near = NEAR_SIGMAS * (sigma if sigma is not None and sigma > EXACT else 0.02 * span)
    wide = np.linspace(-span, span, NUM_SAMPLES)
    return np.sort(np.concatenate([wide[np.abs(wide) > near], np.linspace(-near, near, NUM_NEAR)]))


def curve_plots(curves: Sequence[Curve]) -> list[Plot]:
    """Draw curves on one scale of information, so that sharp and flat ones can be compared."""
    low = min(float(curve.nats.min()) for curve in curves)
    high = max(float(curve.nats.max()) for curve in curves)
    margin = HEADROOM * (high - low) or 1.0
    return [_curve_plot(curve, low - margin, high + margin) for curve in curves]


def _curve_plot(curve: Curve, low: float, high: float) -> Plot:
    def draw(axes: Axes) -> None:
        span = float(curve.offsets[-1])
        axes.set(xlim=(-span, span), ylim=(low, high), xlabel=curve.unit)
        axes.locator_params(nbins=4)
        if curve.sigma is not None:
            half = max(2.0 * curve.sigma, MIN_BAND * span)
            axes.axvspan(-half, half, color=ACCENT, alpha=0.3, linewidth=0.0, gid="band")
        axes.axvline(0.0, color=SOFT, linestyle=":", linewidth=1.0)
        axes.axvline(curve.optimum, color=BAD, linestyle="--", linewidth=1.0)
        axes.plot(curve.offsets, curve.nats, color=ACCENT, linewidth=2.0)

    # The optimum gets as many digits as the spacing of the samples near the pose has.
    digits = max(0, -math.floor(math.log10(float(np.diff(curve.offsets).min()))))
    note = f"maximum near {curve.optimum:+.{digits}f} {curve.unit}"
    if curve.sigma is not None:
        note += f", two standard errors: {2.0 * curve.sigma:.2g} {curve.unit}"
    return Plot(curve.name, page_svg(curve.name, SIZE, draw), note)


def frame_pixels(
    observations: Observations, T_camera_lidar: Pose, frame_offsets: FrameOffsets
) -> npt.NDArray[np.float64]:
    """Measure how far the points of each of F frames move in the image from the pose of all to the frame's own.

    Returns:
        (F,) medians over the points visible at both poses, pixels; NaN where the frame has no pose of its own.
    """
    medians = np.full(len(frame_offsets.offsets), np.nan)
    before = View(observations, T_camera_lidar)
    for frame in np.flatnonzero(frame_offsets.is_determined).tolist():
        shift, turn = np.split(frame_offsets.offsets[frame], 2)
        T_own = pose_at(T_camera_lidar, np.concatenate([-shift, np.radians(turn)]))
        a, b = before.project_frame(frame), View(observations, T_own).project_frame(frame)
        _, in_a, in_b = np.intersect1d(a.indices, b.indices, return_indices=True)
        is_visible = ~(a.is_hidden[in_a] | b.is_hidden[in_b])
        if is_visible.any():
            moved = (a.positions[in_a] - b.positions[in_b])[is_visible]
            medians[frame] = np.median(np.linalg.norm(moved, axis=1))
    return medians


def pixels_plot(pixels: npt.NDArray[np.float64], names: Sequence[str]) -> Plot:
    """Draw a bar for each of F frames: how far its own pose moves its points, pixels. The worst is marked."""
    frames, worst = np.arange(len(names), dtype=np.float64), int(np.nanargmax(pixels))

    def draw(axes: Axes) -> None:
        axes.set(xlim=(-0.5, len(names) - 0.5), xlabel="frame")
        axes.grid(visible=False, axis="x")
        colors = [BAD if frame == worst else ACCENT for frame in range(len(names))]
        axes.bar(frames, np.nan_to_num(pixels), color=colors)
        name_places(axes, frames, short_names(names))

    note = (
        f"median {np.nanmedian(pixels):.1f} pixels, most in {names[worst]}: {pixels[worst]:.1f}; "
        f"--exclude {names[worst]} leaves it out of calibrate and verify"
    )
    return Plot("points of the frame, pixels", page_svg("pixels, frame by frame", FRAMES_SIZE, draw), note)


def frames_plots(offsets: FrameOffsets, names: Sequence[str]) -> list[Plot]:
    """Draw the offsets of the camera's position and rotation in each of the named frames."""
    return [
        _frames_plot("camera centre, cm", slice(0, 3), 100.0, MAX_SPANS[0], offsets, names),
        _frames_plot("rotation, degrees", slice(3, 6), 1.0, MAX_SPANS[1], offsets, names),
    ]


def _frames_plot(
    name: str, axis: slice, scale: float, max_span: float, frame_offsets: FrameOffsets, names: Sequence[str]
) -> Plot:
    """Draw the scaled offsets along or about three axes."""
    offsets, half_widths, of_parts = (
        scale * array[:, axis]
        for array in (frame_offsets.offsets, frame_offsets.half_widths_95, frame_offsets.of_parts)
    )
    reach = np.nanmax(np.abs(np.vstack([offsets, of_parts])), initial=0.0)
    wide = np.nanmax(np.abs(offsets) + half_widths, initial=0.0)
    # Intervals much wider than all offsets are cut, so that they do not flatten the offsets.
    span = min(max(min(wide, 4.0 * reach), reach, MIN_SPAN), max_span)
    frames = np.arange(len(names), dtype=np.float64)

    def draw(axes: Axes) -> None:
        axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(-1.05 * span, 1.05 * span), xlabel="frame")
        axes.locator_params(axis="y", nbins=5)
        axes.grid(visible=False, axis="x")
        axes.axhline(0.0, color=SOFT, linestyle=":", linewidth=1.0)
        for i, color in enumerate(AXIS_COLORS):
            if of_parts.any():
                edges = np.append(frames, len(names)) - 0.5
                axes.stairs(of_parts[:, i], edges, baseline=None, color=color, linestyle="--", gid="step")
            is_finite = np.isfinite(offsets[:, i])
            x = frames[is_finite] + min(MAX_BAR_DISTANCE[0], MAX_BAR_DISTANCE[1] * len(names)) * (i - 1)
            draw_intervals(axes, x, offsets[is_finite, i].clip(-span, span), half_widths[is_finite, i], color)
        name_places(axes, frames, short_names(names))

    return Plot(name, page_svg(f"{name}, frame by frame", FRAMES_SIZE, draw))
