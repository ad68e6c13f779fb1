//! The distance that a LiDAR moves between two sweeps, seen from the sweeps alone.
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
/// Precision of a shift, metres.
pub const STEP_M: f64 = 0.05;
/// Steps, metres, and number of steps to each side, of the grids of shifts, each around the best one before. The first
/// reaches 3 m, or 30 m/s at 10 sweeps per second.
const GRIDS: [(f64, i32); 3] = [(0.25, 12), (0.1, 3), (STEP_M, 2)];
/// Smallest share of directions with the same range after the best shift. It was 0.51 to 0.76 for 23 pairs of consecutive
/// sweeps of KITTI raw at 7 to 9 m/s and KITTI-360 at 10 m/s, where the shift is right within 5 cm, and at most 0.34 for 17
/// pairs of DDAD a second apart and of different places of KITTI.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Posts around a street on flat ground, 2 m below a LiDAR at a place along it.
    fn sweep(at_m: f32) -> Vec<[f32; 3]> {
        let ground = (0..8000).map(|k| {
            let (azimuth, range) = (k as f32 * 0.1, 3.0 + (k % 97) as f32 * 0.25);
            [range * azimuth.cos(), range * azimuth.sin(), -2.0]
        });
        let posts = (0..150).flat_map(|k| {
            let (x, y) = ((k * 37 % 101) as f32 - 50.0 - at_m, if k % 2 == 0 { 6.0 } else { -9.0 });
            (0..40).map(move |step| [x, y + (k % 7) as f32 * 0.5, -2.0 + step as f32 * 0.2])
        });
        ground.chain(posts).collect()
    }

    #[test]
    fn a_drive_along_a_street_is_measured() {
        let [first, second] = [sweep(0.0), sweep(1.4)];
        let found = sweep_shifts(&[[&first, &second], [&first, &first]]);
        assert_eq!(found[1], Some(0.0));
        assert!((found[0].expect("a shift") - 1.4).abs() <= STEP_M, "{found:?}");
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let [first, second] = [sweep(0.0), sweep(0.6)];
        let with = |count| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("threads");
            pool.install(|| sweep_shifts(&[[&first, &second]]))
        };
        assert_eq!(with(1), with(4));
    }

    #[test]
    fn what_cannot_be_seen_has_no_distance() {
        let [street, elsewhere] = [sweep(0.0), sweep(40.0)];
        let unknown = vec![[f32::NAN; 3]; 100];
        assert_eq!(sweep_shifts(&[]), []);
        assert_eq!(sweep_shifts(&[[&street, &elsewhere], [&street, &[]]]), [None, None]);
        assert_eq!(sweep_shifts(&[[&[], &[]]]), [None]);
        assert_eq!(sweep_shifts(&[[&street, &unknown]]), [None]);
    }
}
