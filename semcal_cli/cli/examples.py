"""The examples in the help of the commands, which tests parse."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("demo",),
    "import bag": ("import bag recording.mcap -o my_drive", "import bag recording.mcap --list"),
    "import folder": (
        "import folder --points 'lidar/*.pcd' --images 'front/*.png' --camera-info camera.yaml -o my_drive",
    ),
    "label": ("label my_drive --image-model cityscapes -o labelled",),
    "inspect": ("inspect my_drive", "inspect my_drive --frames"),
    "accumulate": ("accumulate my_drive --seconds 0.5 -o dense",),
    "merge": ("merge morning evening -o both",),
    "odometry": ("odometry my_drive -o poses.txt",),
    "synth": ("synth street --frames 20",),
    "doctor": ("doctor",),
    "calibrate": (
        "calibrate recording.mcap",
        "calibrate my_drive --init tf.yaml -o front.yaml --report front.html",
    ),
    "initialize": ("initialize my_drive -o start.yaml",),
    "refine": ("refine my_drive --init start.yaml -o front.yaml",),
    "verify": (
        "verify recording.mcap",
        "verify new_drive front.yaml",
        "verify new_drive front.yaml --max-translation-m 0.03 --junit front.xml",
    ),
    "compare": ("compare front.yaml last_year.yaml",),
    "report": ("report my_drive front.yaml -o front.html",),
    "overlay": ("overlay my_drive front.yaml -o front_overlay",),
    "view": ("view my_drive -o start.yaml",),
    "convert": (
        "convert front.yaml --to ros2-static-transform",
        "convert front.yaml --to urdf --base base.yaml -o front.urdf",
        "convert T.txt --direction lidar-to-camera --to semcal -o start.yaml",
    ),
    "base": ("base my_drive --xy-m 1.2 0 -o base.yaml",),
    "export rerun": ("export rerun my_drive front.yaml -o front.rrd",),
    "export mcap": ("export mcap my_drive front.yaml -o front.mcap",),
    "export nerfstudio": ("export nerfstudio my_drive front.yaml -o transforms.json",),
    "export colmap": ("export colmap rig.yaml results -o rig_config.json",),
    "export ply": ("export ply my_drive front.yaml -o points",),
    "batch": (
        "batch 'drives/*' -o results",
        "batch drives -o results --command verify --calibration front.yaml",
    ),
    "fleet": ("fleet results --report fleet.html",),
    "audit": ("audit drives -o audit.html --cue edges", "audit 'scenes/*/rig.yaml' -o audit.html --jobs 2"),
    "experiment pairs": (
        "experiment pairs --seeds 1 --pairs 1 --pairs 5 --method semcal --method SOIC -o results",
    ),
    "experiment noise": ("experiment noise --seeds 1 -o results",),
    "experiment table": ("experiment table my_drive -o results",),
}
"""Examples by the names of commands; those of a data set's import follow from its name."""


def examples_of(command_path: str) -> tuple[str, ...]:
    """List the examples of a command, by its path such as `semcal import bag`."""
    program, _, name = command_path.partition(" ")
    group, _, data_set = name.partition(" ")
    data_set_examples = (f"import {data_set} ROOT -o my_drive",) if group == "import" and data_set else ()
    return tuple(f"{program} {example}" for example in EXAMPLES.get(name, data_set_examples))
