"""What the cues of a drive state together."""

from __future__ import annotations

from dataclasses import dataclass

from semcal_cli.config import CueName, StartsConfig
from semcal_cli.observations.cues.cue import Cue


@dataclass(frozen=True)
class Policy:
    """The cues of a drive by their names, and what follows from what each of them states."""

    cues: dict[CueName, Cue]

    @property
    def refined(self) -> tuple[CueName, ...]:
        """Cues by which a pose is refined: beside one that cannot find mountings, coarse ones only bring it near."""
        return tuple(name for name, cue in self.cues.items() if not (self.near_only and cue.is_coarse))

    @property
    def coarse(self) -> tuple[CueName, ...]:
        """Cues that only bring a pose near."""
        return tuple(name for name in self.cues if name not in self.refined)

    @property
    def checked_by(self) -> CueName:
        """Cue by which a pose is checked: the first that refines it; beside local ones, not a coarse one.

        It is one cue, since pixels of one say nothing about points of another. Labels show most, then edges. Segments
        bring a pose near; next to them, intensity shows small offsets.
        """
        first, *others = self.refined
        is_beside_local = others and all(self.cues[name].is_local for name in others)
        return others[0] if self.cues[first].is_coarse and is_beside_local else first

    @property
    def searched_by(self) -> CueName | None:
        """Cue by which mountings are searched for; None if it is all those together that refine a pose.

        A cue that is coarse or cannot find mountings is not added to others: edges and intensity only show small
        offsets, but would weigh as much as segments.
        """
        if all(cue.can_find_mounting and not cue.is_coarse for cue in self.cues.values()):
            return None
        alone = (name for name, cue in self.cues.items() if cue.finds_mounting_alone)
        return min(alone, key=lambda name: self.cues[name].is_coarse, default=None)

    @property
    def starts(self) -> StartsConfig | None:
        """Starts of a cue that is compared alone, if it states them, or else `starts_together`."""
        if len(self.cues) == 1:
            (cue,) = self.cues.values()
            return cue.starts_alone or cue.starts
        return self.starts_together

    @property
    def starts_together(self) -> StartsConfig | None:
        """The farthest starts of any cue that refines; None if one brings the pose near on its own."""
        starts = [self.cues[name].starts for name in self.refined]
        several = [each for each in starts if each is not None]
        return max(several, key=lambda start: start.farthest_deg) if len(several) == len(starts) else None

    @property
    def can_find_mounting(self) -> bool:
        """Whether mounting directions can be distinguished; edges alone only work near the right pose."""
        return not self.near_only or any(cue.finds_mounting_alone for cue in self.cues.values())

    @property
    def near_only(self) -> tuple[CueName, ...]:
        """Cues that cannot find mountings."""
        return tuple(name for name, cue in self.cues.items() if not cue.can_find_mounting)

    @property
    def weak(self) -> tuple[CueName, ...]:
        """Cues by which a pose is refined, if all of them are weak; else none."""
        return self.refined if all(self.cues[name].is_weak for name in self.refined) else ()

    @property
    def needs_near_start(self) -> bool:
        """Whether a pose is refined from around a start near the right one, as by edges without labels."""
        return not all(cue.can_find_mounting for cue in self._decisive.values())

    @property
    def wanting_scenes(self) -> dict[CueName, int]:
        """Minimum number of scenes of each cue that states one and decides on the pose."""
        return {name: cue.min_scenes for name, cue in self._decisive.items() if cue.min_scenes > 1}

    @property
    def _decisive(self) -> dict[CueName, Cue]:
        """Cues whose one maximum is the right one, as that of labels is; all if there are none."""
        sure = {
            name: cue for name, cue in self.cues.items() if cue.finds_mounting_alone and not cue.is_multimodal
        }
        return sure or self.cues

    def weight(self, name: CueName) -> float:
        """Return the weight of a cue's points when a pose is refined."""
        is_beside_local = any(cue.is_local for other, cue in self.cues.items() if other != name)
        return self.cues[name].weight_beside_local if is_beside_local else 1.0

    @property
    def unit(self) -> str:
        """Unit of the information, as `Observations.unit`."""
        return "AMI" if any(self.cues[name].has_partitions for name in self.refined) else "nats"

    @property
    def has_label_bleed(self) -> bool:
        """Whether borders of image labels are all that the pose depends on."""
        return all(cue.has_image_labels for cue in self.cues.values())
