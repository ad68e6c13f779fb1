//! Splitting of large segments into pieces.
//!
//! A set of points is halved across its longest direction, at its thinnest place near the middle, until no piece is
//! too long. The cuts rotate with the points, since they depend on no other axes.

use nalgebra::{Matrix3, Vector3};

/// Slices of a set along its longest direction.
const NUM_SLICES: usize = 16;
/// Distance from the middle, in slices, within which the thinnest place is searched.
const NEAR_MIDDLE: usize = 3;

/// Pieces no longer than `size`, metres, with at least `min_points` points, wherever enough points are that close
/// together. A smaller set has no piece, and isolated points are in none.
pub(super) fn into_pieces(
    points: &[Vector3<f64>],
    members: Vec<usize>,
    size: f64,
    min_points: usize,
) -> Vec<Vec<usize>> {
    let (mut open, mut pieces) = (vec![members], Vec::new());
    while let Some(members) = open.pop() {
        if members.len() < min_points {
            continue;
        }
        match halved(points, &members, size, min_points) {
            Some((left, right)) => open.extend([right, left]),
            None => pieces.push(members),
        }
    }
    pieces
}

/// The two sides of a cut, at least one of which has `min_points`; `None` if the set is short enough, or too
/// sparse.
fn halved(
    points: &[Vector3<f64>],
    members: &[usize],
    size: f64,
    min_points: usize,
) -> Option<(Vec<usize>, Vec<usize>)> {
    let axis = longest_direction(points, members);
    let along: Vec<f64> = members.iter().map(|&i| points[i].dot(&axis)).collect();
    let bounds = |(low, high): (f64, f64), &x: &f64| (low.min(x), high.max(x));
    let (low, high) = along.iter().fold((f64::INFINITY, f64::NEG_INFINITY), bounds);
    if high - low <= size {
        return None;
    }
    let slice_of = |x: f64| (((x - low) / (high - low) * NUM_SLICES as f64) as usize).min(NUM_SLICES - 1);
    let mut counts = [0; NUM_SLICES];
    along.iter().for_each(|&x| counts[slice_of(x)] += 1);
    let first_right = best_cut(&counts, min_points)?;
    let is_left = |&(_, &x): &(&usize, &f64)| slice_of(x) < first_right;
    let (left, right): (Vec<_>, Vec<_>) = members.iter().zip(&along).partition(is_left);
    let only_members = |side: Vec<(&usize, &f64)>| side.into_iter().map(|(&member, _)| member).collect();
    Some((only_members(left), only_members(right)))
}

fn best_cut(counts: &[usize; NUM_SLICES], min_points: usize) -> Option<usize> {
    let total: usize = counts.iter().sum();
    let thickness = |cut: usize| counts[cut - 1] + counts[cut];
    let quality = |cut: usize| {
        let left: usize = counts[..cut].iter().sum();
        let fewer = left.min(total - left);
        let off_middle = cut.abs_diff(NUM_SLICES / 2);
        let is_near = off_middle <= NEAR_MIDDLE;
        // Prefer two sides that are both large enough, then a place near the middle, then the thinnest one.
        (fewer < min_points, if is_near { 0 } else { off_middle }, thickness(cut), off_middle)
    };
    let cut = (1..NUM_SLICES).min_by_key(|&cut| quality(cut))?;
    let left: usize = counts[..cut].iter().sum();
    (left.max(total - left) >= min_points).then_some(cut)
}

fn longest_direction(points: &[Vector3<f64>], members: &[usize]) -> Vector3<f64> {
    let mean = members.iter().map(|&i| points[i]).sum::<Vector3<f64>>() / members.len() as f64;
    let mut spread = Matrix3::zeros();
    for &i in members {
        let offset = points[i] - mean;
        spread += offset * offset.transpose();
    }
    let eigen = spread.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
}
