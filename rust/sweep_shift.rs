//! How far a rig drives from one sweep to the next, seen from the sweeps alone.
//!
//! What stands above the ground is shifted over the ground until most directions see it at the same range in both
//! sweeps. The ground itself looks the same from everywhere, and neither poses nor times are needed.

use nalgebra::{Matrix2x3, RowVector2, Vector3};
use rayon::prelude::*;

use crate::point_cloud::to_f64;
use crate::scenes::NearestRanges;
use crate::segmentation::{Up, estimate_up};

/// Smallest height of points that do not count as ground, which slopes and bends, metres.
const MIN_HEIGHT_M: f64 = 0.5;
/// Range within which points may lie on the rig itself, which moves along, metres.
const OWN_RANGE_M: f64 = 2.0;
/// Number of points that are shifted, or up to twice as many. With half of them, two of 11 pairs of KITTI-360 are lost.
const NUM_POINTS: usize = 8_000;
/// Steps, metres, and number of steps to each side, of the grids of shifts, each around the best one before. The first
/// reaches 3 m, or 30 m/s at 10 sweeps per second.
const GRIDS: [(f64, i32); 3] = [(0.25, 12), (0.1, 3), (0.05, 2)];
/// Smallest share of directions with the same range after the best shift. It is 0.51 to 0.75 for consecutive sweeps of
/// KITTI raw at 7 to 9 m/s and KITTI-360 at 10 m/s, where the shift is right within 5 cm, and at most 0.34 for sweeps of
/// DDAD a second apart and of different places of KITTI (`tests/benchmarks/clocks.py`).
const MIN_SHARE: f64 = 0.5;

/// How far the LiDAR moves over the ground between the two sweeps of each pair, metres; `None` where it cannot be seen.
pub fn sweep_shifts(pairs: &[[&[[f32; 3]]; 2]]) -> Vec<Option<f64>> {
    let Some(up) = estimate_up(&pairs.concat()) else { return vec![None; pairs.len()] };
    let across = across(&up);
    pairs.par_iter().map(|pair| shift(pair.map(|sweep| above_ground(sweep, &up)), &across)).collect()
}

fn above_ground(sweep: &[[f32; 3]], up: &Up) -> Vec<[f32; 3]> {
    let is_above = |point: &&[f32; 3]| {
        let point = to_f64(point);
        point.dot(&up.direction) > MIN_HEIGHT_M - up.height_m && point.norm() > OWN_RANGE_M
    };
    sweep.iter().filter(is_above).copied().collect()
}

/// Two unit vectors that span the ground, as rows.
fn across(up: &Up) -> Matrix2x3<f64> {
    let side = up.direction.cross(&Vector3::ith(up.direction.iamin(), 1.0)).normalize();
    Matrix2x3::from_rows(&[side.transpose(), up.direction.cross(&side).transpose()])
}

fn shift([first, second]: [Vec<[f32; 3]>; 2], across: &Matrix2x3<f64>) -> Option<f64> {
    let few: Vec<[f32; 3]> = first.iter().step_by((first.len() / NUM_POINTS).max(1)).copied().collect();
    let seen = NearestRanges::of(&second);
    let share = |moved: &mut NearestRanges, shift: RowVector2<f64>| {
        moved.set(&few, (shift * across).map(|x| x as f32).into());
        moved.share_alike(&seen)
    };
    let mut best = (share(&mut NearestRanges::default(), RowVector2::zeros()), RowVector2::zeros());
    for (step_m, count) in GRIDS {
        let steps = (-count..=count).flat_map(|x| (-count..=count).map(move |y| [x, y]));
        let shifts: Vec<_> = steps.map(|xy| best.1 + step_m * RowVector2::from(xy.map(f64::from))).collect();
        let tried = shifts
            .into_par_iter()
            .map_init(NearestRanges::default, |moved, shift| (share(moved, shift), shift));
        // The first in a tie, whatever the number of threads.
        for tried in tried.collect::<Vec<_>>() {
            if tried.0 > best.0 {
                best = tried;
            }
        }
    }
    (best.0 >= MIN_SHARE).then(|| best.1.norm())
}
