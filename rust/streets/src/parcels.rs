//! The land behind the sidewalks: houses, gardens and parks parcel by parcel, and a backdrop that closes the horizon.

use std::f32::consts::{FRAC_PI_2, PI};

use rand::RngExt;

use crate::buildings::{self, Size};
use crate::mesh::Place;
use crate::street::{Site, is_near_branch};
use crate::{furniture, people, vegetation};

/// Parcels are laid out along this much of the street in either direction.
const REACH: f32 = 92.0;
const PARCEL_WIDTHS: std::ops::Range<f32> = 9.0..19.0;
/// Distance from the centre line of the taller houses and trees behind the parcels.
const BACKDROP: std::ops::Range<f32> = 48.0..58.0;

/// A piece of land that fronts the street from `s` over `width` metres.
struct Parcel {
    side: usize,
    s: f32,
    width: f32,
}

impl Parcel {
    /// Street coordinates at a fraction of the width, `depth` metres behind the sidewalk.
    fn spot(&self, site: &Site, share: f32, depth: f32) -> (f32, f32) {
        let sign = if self.side == 1 { 1.0 } else { -1.0 };
        let d = sign * (site.street.frontage_at(self.side) + depth);
        (self.s + share * self.width, d)
    }

    /// The middle of a front line, its local y pointing away from the street.
    fn front(&self, site: &Site, share: f32, depth: f32) -> Place {
        let (s, d) = self.spot(site, share, depth);
        site.street.place(s, d, if self.side == 1 { 0.0 } else { PI })
    }

    /// The start of a line along the whole front, and its length.
    fn edge(&self, site: &Site, depth: f32) -> (Place, f32) {
        let [from, to] = [0.02, 0.98].map(|share| {
            let (s, d) = self.spot(site, share, depth);
            site.street.place(s, d, 0.0).origin
        });
        let along = to - from;
        (Place::new(from, along.y.atan2(along.x)), along.truncate().length())
    }
}

/// Fills one side of the street with parcels, leaving the side street open.
pub fn build(site: &mut Site, side: usize) {
    let mut s = -REACH;
    while s < REACH {
        let width = site.builder.rng.random_range(PARCEL_WIDTHS);
        let middle = s + 0.5 * width;
        let sidewalk = site.street.branch(side).map_or(0.0, |branch| branch.sidewalk);
        if is_near_branch(&site.street, side, middle, 0.5 * width + sidewalk + 0.5) {
            s += 1.0;
            continue;
        }
        let parcel = Parcel { side, s, width };
        match site.builder.rng.random_range(0..10) {
            0..=3 => town_house(site, &parcel),
            4..=7 => garden_house(site, &parcel),
            _ => park(site, &parcel),
        }
        s += width
            + if site.builder.rng.random_bool(0.3) { site.builder.rng.random_range(1.0..4.0) } else { 0.2 };
    }
}

/// A tall house at the sidewalk.
fn town_house(site: &mut Site, parcel: &Parcel) {
    let setback = site.builder.rng.random_range(1.1..2.5);
    let size = Size {
        width: parcel.width - 0.3,
        depth: site.builder.rng.random_range(9.0..13.0),
        height: site.builder.rng.random_range(7.0..17.0),
    };
    let place = parcel.front(site, 0.5, setback);
    buildings::house(&mut site.builder, &place, size);
    if site.builder.rng.random_bool(0.4) {
        let place = parcel.front(site, 0.2, 0.6);
        vegetation::bush(&mut site.builder, &place, 0.5);
    }
}

/// A lower house behind a garden, enclosed by a fence, a wall or a hedge.
fn garden_house(site: &mut Site, parcel: &Parcel) {
    let setback = site.builder.rng.random_range(4.0..9.0);
    let share = site.builder.rng.random_range(0.4..0.6);
    let size = Size {
        width: parcel.width * site.builder.rng.random_range(0.55..0.75),
        depth: site.builder.rng.random_range(7.0..10.0),
        height: site.builder.rng.random_range(3.5..8.0),
    };
    let place = parcel.front(site, share, setback);
    buildings::house(&mut site.builder, &place, size);
    enclosure(site, parcel);
    for share in [0.1, 0.35, 0.65, 0.9] {
        plant(site, parcel, share, setback);
    }
    let by_the_house = parcel.front(site, 0.5 * share, 0.75 * setback);
    match site.builder.rng.random_range(0..3) {
        0 => people::bicycle(&mut site.builder, &by_the_house),
        1 => furniture::wheeled_bins(&mut site.builder, &by_the_house),
        _ => people::pedestrian(&mut site.builder, &by_the_house),
    }
}

/// The border between the sidewalk and a garden: a fence, a wall or a hedge.
fn enclosure(site: &mut Site, parcel: &Parcel) {
    let (place, length) = parcel.edge(site, 0.4);
    let b = &mut site.builder;
    match b.rng.random_range(0..5) {
        0 | 1 => furniture::fence(b, &place, length),
        2 => {
            let height = b.rng.random_range(0.7..1.9);
            furniture::wall(b, &place, length, height);
        }
        3 => {
            let height = b.rng.random_range(0.8..1.7);
            vegetation::hedge(b, &place, length, height);
        }
        _ => {
            furniture::wall(b, &place, length, 0.45);
            let above = Place { origin: place.at(0.0, 0.0, 0.5), ..place };
            furniture::railing(b, &above, length);
        }
    }
}

/// A tree, a conifer or a bush in a garden.
fn plant(site: &mut Site, parcel: &Parcel, share: f32, depth: f32) {
    let place = parcel.front(site, share, depth * 0.5 + 0.6);
    let b = &mut site.builder;
    match b.rng.random_range(0..4) {
        0 => {
            let height = b.rng.random_range(4.5..9.0);
            vegetation::tree(b, &place, height);
        }
        1 => {
            let height = b.rng.random_range(3.0..8.0);
            vegetation::conifer(b, &place, height);
        }
        _ => {
            let radius = b.rng.random_range(0.5..1.1);
            vegetation::bush(b, &place, radius);
        }
    }
}

/// Grass with trees, bushes and benches, with or without a fence, and a house far behind.
fn park(site: &mut Site, parcel: &Parcel) {
    if site.builder.rng.random_bool(0.5) {
        enclosure(site, parcel);
    }
    for i in 0..6 {
        let share = 0.1 + 0.16 * i as f32;
        let depth = site.builder.rng.random_range(3.0..30.0);
        plant(site, parcel, share, depth);
    }
    for _ in 0..2 {
        let share = site.builder.rng.random_range(0.1..0.9);
        let depth = site.builder.rng.random_range(2.0..9.0);
        let stroller = parcel.front(site, share, depth);
        people::pedestrian(&mut site.builder, &stroller);
    }
    let bench = parcel.front(site, 0.5, 1.6);
    furniture::bench(&mut site.builder, &Place { heading: -bench.heading, ..bench });
    let size = Size { width: parcel.width, depth: 9.0, height: site.builder.rng.random_range(5.0..12.0) };
    let place = parcel.front(site, 0.5, 24.0);
    buildings::house(&mut site.builder, &place, size);
}

/// Tall houses and trees all around, so that no line of sight ends on bare ground.
pub fn backdrop(site: &mut Site) {
    for side in [0, 1] {
        let sign = if side == 1 { 1.0 } else { -1.0 };
        let mut s = -100.0;
        while s < 100.0 {
            let d = sign * site.builder.rng.random_range(BACKDROP);
            let place = site.street.place(s, d, if side == 1 { 0.0 } else { PI });
            far_object(site, &place);
            s += site.builder.rng.random_range(9.0..15.0);
        }
    }
    for (s, yaw) in [(98.0, -FRAC_PI_2), (-98.0, FRAC_PI_2)] {
        for i in -4..=4 {
            let place = site.street.place(s, 12.0 * i as f32, yaw);
            far_object(site, &place);
        }
    }
}

fn far_object(site: &mut Site, place: &Place) {
    let b = &mut site.builder;
    if b.rng.random_bool(0.7) {
        let size = Size { width: 13.0, depth: 8.0, height: b.rng.random_range(8.0..19.0) };
        buildings::house(b, place, size);
    } else {
        for x in [-4.0, 0.0, 4.0] {
            let height = b.rng.random_range(8.0..13.0);
            vegetation::tree(b, &place.shifted(x, 0.0, 0.0, 0.0), height);
        }
    }
}
