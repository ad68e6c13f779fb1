//! Null partitions: the segments of a sweep in another place, as if it had been rotated about its axis.

use std::f64::consts::{PI, TAU};

use geometry::angles::{azimuth, elevation, wrapped};
use nalgebra::{UnitVector3, Vector3};
use rayon::prelude::*;

use super::up::upright;
use super::{NO_SEGMENT, SegmentedSweep};
use crate::error::Result;
use crate::observation::Partitions;
use crate::point_cloud::to_f64;

/// Height of a row of directions, radians, about the ring spacing of a dense sweep.
const ROW: f64 = 0.4 * PI / 180.0;
const NUM_ROWS: usize = (PI / ROW) as usize + 1;
/// Width of the bins that measure which azimuths the sweeps cover, radians.
const BIN: f64 = PI / 180.0;
const NUM_BINS: usize = 360;
/// Smallest gap in azimuth that counts, bins.
const MIN_GAP_BINS: usize = 30;

/// The segments of each sweep, and of each as if it had been rotated by `1, 2, ... num_turns` of `num_turns + 1`
/// equal parts of the azimuths that the sweeps cover, with wrap-around. A point gets the segment of the return
/// nearest to it in the rotated sweep, at about its elevation.
pub fn turned(
    sweeps: &[&[[f32; 3]]],
    segmented: &[&SegmentedSweep],
    num_turns: usize,
) -> Result<Vec<Partitions>> {
    let up = segmented.iter().find_map(|sweep| sweep.up).unwrap_or_else(Vector3::z_axis);
    let directions: Vec<Vec<SegmentDirection>> =
        sweeps.par_iter().zip(segmented).map(|(points, sweep)| directions(points, sweep, &up)).collect();
    let covered = CoveredAzimuths::of(directions.iter().flatten());
    let partitions =
        |((points, sweep), directions): ((&&[[f32; 3]], &&SegmentedSweep), &Vec<SegmentDirection>)| {
            let rows = Rows::of(directions);
            let mut ids = vec![0; points.len() * (num_turns + 1)];
            for direction in directions {
                let of_point = &mut ids[direction.point * (num_turns + 1)..][..=num_turns];
                for (turn, id) in of_point.iter_mut().enumerate() {
                    let azimuth = covered.shifted(direction.azimuth, turn as f64 / (num_turns + 1) as f64);
                    *id = if turn == 0 { direction.id } else { rows.nearest(azimuth, direction.row) };
                }
            }
            Partitions::new(&ids, sweep.kinds.len(), num_turns + 1)
        };
    sweeps.par_iter().zip(segmented).zip(&directions).map(partitions).collect()
}

struct SegmentDirection {
    point: usize,
    id: u32,
    /// Azimuth about the direction away from the ground, radians.
    azimuth: f64,
    row: usize,
}

fn directions(points: &[[f32; 3]], sweep: &SegmentedSweep, up: &UnitVector3<f64>) -> Vec<SegmentDirection> {
    let points: Vec<Vector3<f64>> = points.iter().map(to_f64).collect();
    let pairs = upright(&points, up).into_iter().zip(&sweep.ids).enumerate();
    let direction = |(point, (position, &id)): (usize, (Vector3<f64>, &u32))| {
        let row = ((elevation(&position) + 0.5 * PI) / ROW) as usize;
        let azimuth = azimuth(&position);
        (id != NO_SEGMENT).then(|| SegmentDirection { point, id, azimuth, row: row.min(NUM_ROWS - 1) })
    };
    pairs.filter_map(direction).collect()
}

/// The azimuths that sweeps cover, radians.
struct CoveredAzimuths {
    start: f64,
    width: f64,
}

impl CoveredAzimuths {
    fn of<'a>(directions: impl Iterator<Item = &'a SegmentDirection>) -> Self {
        let mut filled = [false; NUM_BINS];
        for direction in directions {
            filled[(((direction.azimuth + PI) / BIN) as usize).min(NUM_BINS - 1)] = true;
        }
        // The longest run of empty bins around the turn.
        let run = |first: usize| (first..first + NUM_BINS).take_while(|bin| !filled[bin % NUM_BINS]).count();
        let (first, gap) =
            (0..NUM_BINS).map(|first| (first, run(first))).max_by_key(|&(_, gap)| gap).unwrap_or((0, 0));
        if gap < MIN_GAP_BINS || gap == NUM_BINS {
            return Self { start: -PI, width: TAU };
        }
        Self { start: (first + gap) as f64 * BIN - PI, width: (NUM_BINS - gap) as f64 * BIN }
    }

    /// An azimuth shifted by a fraction of the width, in -pi to pi.
    fn shifted(&self, azimuth: f64, share: f64) -> f64 {
        let from_start = (azimuth - self.start).rem_euclid(TAU);
        let shifted = self.start + (from_start + share * self.width) % self.width;
        wrapped(shifted)
    }
}

/// The segments of returns by elevation, and by azimuth within a row.
struct Rows {
    rows: Vec<Vec<(f64, u32)>>,
    /// The nearest row with returns, for each row.
    filled: Vec<usize>,
}

impl Rows {
    fn of(directions: &[SegmentDirection]) -> Self {
        let mut rows = vec![Vec::new(); NUM_ROWS];
        directions.iter().for_each(|direction| rows[direction.row].push((direction.azimuth, direction.id)));
        rows.iter_mut().for_each(|row| row.sort_by(|a, b| a.0.total_cmp(&b.0)));
        let with_returns: Vec<usize> = (0..NUM_ROWS).filter(|&row| !rows[row].is_empty()).collect();
        let nearest =
            |row: usize| with_returns.iter().copied().min_by_key(|other| other.abs_diff(row)).unwrap_or(row);
        let filled = (0..NUM_ROWS).map(nearest).collect();
        Self { rows, filled }
    }

    /// The segment of the return nearest in azimuth, with wrap-around.
    fn nearest(&self, azimuth: f64, row: usize) -> u32 {
        let row = &self.rows[self.filled[row]];
        let after = row.partition_point(|(other, _)| *other < azimuth);
        let (after, before) = (row[after % row.len()], row[(after + row.len() - 1) % row.len()]);
        let apart = |other: f64| wrapped(other - azimuth);
        if apart(after.0).abs() < apart(before.0).abs() { after.1 } else { before.1 }
    }
}
