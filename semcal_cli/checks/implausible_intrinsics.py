"""Whether K looks like that of a real camera."""

from __future__ import annotations

import numpy as np

from semcal_cli.drive.camera import DEFAULT_FOCAL_SIGMA, Camera, IntrinsicsSigma, sigma_of
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.result.uncertainty import IntrinsicsCost, PoseChange

IMPLAUSIBLE_INTRINSICS = Check(
    topic="implausible-intrinsics",
    entry=Entry(
        title="K is unlike that of a real camera",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "cx in K is 640 in images 1920 wide, 17% of that from the middle, usually at most 4%: "
                "K may belong to images of another size, or the images are cropped"
            ),
            (
                "cy in K is 239 in images 376 high, 14% of that from the middle, usually at most 6%: right only if K "
                "was made for these images after they were cropped"
            ),
            (
                "fx in K is 1.100 times fy, usually 1 within 2%: K may belong to images that were resized "
                "differently"
            ),
        ),
        meaning="The principal point is far from the middle of the image, or pixels are not square.",
        cause="K belongs to images of another size, or the images were cropped or resized out of shape.",
        remedy="Compare K with `camera_info` and the size of the images. KITTI-360's is right: it has cropped images.",
        figure="Distance of cx and cy from the middle, each relative to its side of the image, and of fx / fy from 1.",
    ),
    settings={
        "cx": Limit(
            at_most=0.04,
            unit="%",
            source=(
                "published cameras (KITTI, nuScenes, RELLIS-3D, OpenCalib) are off by at most 3 % of the longer side, "
                "and images of which a tenth was cut off at one side by 5 %"
            ),
        ),
        "cy": Limit(
            at_most=0.06,
            unit="%",
            source=(
                "the same cameras are off by at most 5.7 % of the shorter side; KITTI's with 20 rows cut "
                "off at the top by 9 %, but also KITTI-360's, whose K was made for its rectified strips, by 14 %"
            ),
        ),
        "aspect": Limit(
            at_most=0.02,
            unit="%",
            source=(
                "pixels are square to 0.2 % in the same cameras; images that were resized without keeping their "
                "shape, as 1920 x 1200 to 1280 x 720, differ by 10 %"
            ),
        ),
    },
)


def implausible_intrinsics(camera: Camera) -> dict[str, Finding]:
    """Compare the principal point and the ratio of the focal lengths with those of real cameras.

    Returns:
        A finding for each implausible intrinsic, by name.
    """
    if camera.is_exact:
        return {}  # Its principal point may be anywhere in a full turn.
    (fx, _, cx), (_, fy, cy), _ = camera.K
    measured = {}
    centers = (("cx", cx, camera.width, "wide"), ("cy", cy, camera.height, "high"))
    shares = {name: abs(center - 0.5 * (size - 1)) / size for name, center, size, _ in centers}
    # Each limit is that of a side, and cx of landscapes is along the longer one.
    is_landscape = camera.width >= camera.height
    limits = {"cx": "cx", "cy": "cy"} if is_landscape else {"cx": "cy", "cy": "cx"}
    # Another scale moves both.
    is_scaled = all(share > IMPLAUSIBLE_INTRINSICS.limit(limits[name]) for name, share in shares.items())
    cause = (
        "K may belong to images of another size, or the images are cropped"
        if is_scaled
        else "right only if K was made for these images after they were cropped"
    )
    for name, center, size, side in centers:
        sentence = (
            f"{name} in K is {center:g} in images {size} {side}, {shares[name]:.0%} of that from the middle, usually "
            f"at most {IMPLAUSIBLE_INTRINSICS.limit(limits[name]):.0%}: {cause}"
        )
        measured[name] = IMPLAUSIBLE_INTRINSICS.measured(shares[name], sentence, limits[name])
    sentence = (
        f"fx in K is {fx / fy:.3f} times fy, usually 1 within {IMPLAUSIBLE_INTRINSICS.limit('aspect'):.0%}: K may "
        "belong to images that were resized differently"
    )
    measured["fx"] = IMPLAUSIBLE_INTRINSICS.measured(abs(fx / fy - 1.0), sentence, "aspect")
    return {name: value.finding for name, value in measured.items() if value.finding is not None}


def notes_on_intrinsics(camera: Camera, cost: IntrinsicsCost | None) -> tuple[str, ...]:
    """Note implausible intrinsics with what their errors cost, and errors that no interval contains."""
    notes = []
    for name, finding in implausible_intrinsics(camera).items():
        sentence = finding.sentence
        if cost is not None:
            change: PoseChange = getattr(cost, name)
            moved_m = np.linalg.norm(change.camera_center_m)
            turned_deg = np.linalg.norm(change.rotation_deg)
            by = "each pixel" if name.startswith("c") else f"each {DEFAULT_FOCAL_SIGMA:.1%}"
            moved = f"{100.0 * moved_m:.2f} cm and {turned_deg:.3f} degrees"
            sentence += f"; {by} of error in {name} moves the pose by {moved}"
        notes.append(sentence)
    if cost is None and sigma_of(camera) != IntrinsicsSigma():
        notes.append("the interval does not include errors of K, because their effect could not be computed")
    return tuple(notes)
