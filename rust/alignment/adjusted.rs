//! Adjusted mutual information of segments and image classes (Vinh, Epps and Bailey, JMLR 2010).
//!
//! `S = (I - N) / (H - N)`: I is the mutual information of segments and classes, N its mean over the null
//! partitions, and H the entropy of the classes under the points, which bounds I. S is 0 where segments say no more
//! than any partition of their kind, and 1 where they determine the classes. It favours neither rich nor poor parts
//! of the images: I - N is larger where the image is rich, I / H where it is poor.

use std::ops::Range;

use crate::mutual_information::JointHistogram;
use crate::observation::Observations;

/// Lower bound of the denominator H - N, nats.
const MIN_DENOMINATOR: f64 = 0.02;

/// Contribution of each pair of a joint histogram to the sum over all points.
///
/// Segments contribute to the adjusted information; classes of other frames contribute to the mutual information,
/// nats. Pairs lighter than `floor` count as if they had that weight.
///
/// With `h = -log p(y)` and `n` null partitions, a point adds `(pmi - S h) / (H - N) + S` by its segment and
/// `-(1 - S) pmi / (n (H - N))` by each null one. The sum is S. Its derivative with respect to the pair weights is
/// that of S, as long as the weight of each point is fixed.
pub fn adjusted(joint: &JointHistogram, observations: &Observations, floor: f64) -> Vec<f64> {
    let width = observations.num_image_classes;
    let mut table = joint.pointwise_in_blocks(observations.num_point_classes, floor);
    let frames: Vec<_> = observations.partition_rows().collect();
    let cells = |rows: &Range<usize>| rows.start * width..rows.end * width;
    let information = |table: &[f64], rows: &Range<usize>| {
        let pairs = joint.weights[cells(rows)].iter().zip(&table[cells(rows)]);
        pairs.map(|(w, value)| if *w > 0.0 { w * value } else { 0.0 }).sum::<f64>()
    };
    let (mut of_segments, mut of_nulls, mut columns) = (0.0, 0.0, vec![0.0; width]);
    for rows in &frames {
        let of_frame = joint.columns(joint.rows(rows.segments.clone()));
        columns.iter_mut().zip(of_frame).for_each(|(sum, weight)| *sum += weight);
        of_segments += information(&table, &rows.segments);
        of_nulls += information(&table, &rows.nulls) / rows.num_nulls as f64;
    }
    let total: f64 = columns.iter().sum();
    if total <= 0.0 {
        return table;
    }
    let of_classes: Vec<f64> =
        columns.iter().map(|column| total.ln() - column.max(floor).max(f64::MIN_POSITIVE).ln()).collect();
    let entropy = columns.iter().zip(&of_classes).map(|(column, h)| column * h).sum::<f64>() / total;
    let denominator = (entropy - of_nulls / total).max(MIN_DENOMINATOR);
    let score = (of_segments - of_nulls) / total / denominator;
    for rows in &frames {
        for values in table[cells(&rows.segments)].chunks_exact_mut(width) {
            let pairs = values.iter_mut().zip(&of_classes);
            pairs.for_each(|(value, h)| *value = (*value - score * h) / denominator + score);
        }
        let by = -(1.0 - score) / (rows.num_nulls as f64 * denominator);
        table[cells(&rows.nulls)].iter_mut().for_each(|value| *value *= by);
    }
    table
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::test_scene::segmented;
    use super::*;

    /// Histogram of a frame in which segments see classes by `seen`, and each null partition by `seen_by_null`.
    fn score(seen: impl Fn(usize, usize) -> f64, seen_by_null: impl Fn(usize, usize) -> f64) -> f64 {
        let observations: Arc<Observations> = segmented(1);
        let rows = observations.partition_rows().next().expect("a frame with partitions");
        let width = observations.num_image_classes;
        let mut joint = JointHistogram::new(observations.num_rows, width);
        for row in rows.segments.start..rows.nulls.end {
            let in_partition = (row - rows.segments.start) % rows.segments.len();
            for class in 0..width {
                let weight = if row < rows.nulls.start {
                    seen(in_partition, class)
                } else {
                    seen_by_null(in_partition, class)
                };
                joint.row_mut(row)[class] = weight;
            }
        }
        let table = adjusted(&joint, &observations, 0.0);
        let total: f64 = joint.rows(rows.segments).iter().sum();
        let pairs = joint.weights.iter().zip(&table);
        pairs.map(|(w, value)| if *w > 0.0 { w * value } else { 0.0 }).sum::<f64>() / total
    }

    #[test]
    fn it_is_one_where_segments_determine_the_classes_and_zero_where_null_ones_do_too() {
        let determined = |segment: usize, class: usize| f64::from(segment % 2 == class);
        let alike = |_: usize, class: usize| if class < 2 { 0.5 } else { 0.0 };
        assert!((score(determined, alike) - 1.0).abs() < 1e-9);
        assert!(score(determined, determined).abs() < 1e-9);
        assert!(score(alike, alike).abs() < 1e-9);
        assert!(score(alike, determined) < -0.5);
    }
}
