//! Class scores of networks on a coarse grid, sampled at the pixels of an image.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::label_image::NO_ID;

/// The view of a pixel that is in no view.
pub const NO_VIEW: u8 = u8::MAX;

/// Number of pixels in a chunk of work.
const CHUNK: usize = 4096;

/// Scores of all classes on a grid, classes last.
#[derive(Clone, Debug)]
pub struct Scores<'a> {
    values: Cow<'a, [f32]>,
    rows: usize,
    columns: usize,
    num_classes: usize,
}

/// Places of an image's pixels in views of it, each view with its own scores.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    /// The view of each pixel, or [`NO_VIEW`].
    pub views: &'a [u8],
    /// Column and row of each pixel on the grid of its view's scores; integers are cell centres.
    pub places: &'a [[f32; 2]],
}

impl<'a> Scores<'a> {
    /// Scores with the classes last: `rows * columns * num_classes` values.
    pub fn classes_last(
        values: &'a [f32],
        (rows, columns, num_classes): (usize, usize, usize),
    ) -> Result<Self> {
        Self::checked(Cow::Borrowed(values), (rows, columns, num_classes))
    }

    /// Scores with the classes first: `num_classes * rows * columns` values.
    pub fn classes_first(
        values: &[f32],
        (num_classes, rows, columns): (usize, usize, usize),
    ) -> Result<Self> {
        let cells = rows * columns;
        let mut turned = vec![0.0; values.len()];
        if num_classes > 0 && columns > 0 {
            turned.par_chunks_mut(columns * num_classes).enumerate().for_each(|(row, line)| {
                for (class, plane) in values.chunks_exact(cells).enumerate() {
                    for (column, value) in plane[row * columns..(row + 1) * columns].iter().enumerate() {
                        line[column * num_classes + class] = *value;
                    }
                }
            });
        }
        Self::checked(Cow::Owned(turned), (rows, columns, num_classes))
    }

    fn checked(values: Cow<'a, [f32]>, (rows, columns, num_classes): (usize, usize, usize)) -> Result<Self> {
        if values.is_empty() || values.len() != rows * columns * num_classes {
            return Err(Error::Input(format!(
                "found {} scores for {rows} x {columns} x {num_classes}",
                values.len()
            )));
        }
        if let Some(wrong) = values.par_iter().find_any(|value| !value.is_finite()) {
            return Err(Error::Input(format!("found a score that is {wrong}, expected finite ones")));
        }
        Ok(Self { values, rows, columns, num_classes })
    }

    fn at(&self, column: usize, row: usize) -> &[f32] {
        let first = (row * self.columns + column) * self.num_classes;
        &self.values[first..first + self.num_classes]
    }

    fn highest(&self) -> Vec<u16> {
        self.values.par_chunks_exact(self.num_classes).with_min_len(CHUNK).map(highest).collect()
    }

    /// The class that scores highest in all four cells around a place, and so between them, if there is one.
    fn agreed(&self, cells: &[u16], [x, y]: [f32; 2]) -> Option<u16> {
        let ((left, right, _), (above, below, _)) = (between(x, self.columns), between(y, self.rows));
        let at = |column: usize, row: usize| cells[row * self.columns + column];
        let class = at(left, above);
        let others = [at(right, above), at(left, below), at(right, below)];
        others.iter().all(|other| *other == class).then_some(class)
    }

    /// Samples the scores at a place, bilinear between cell centres and constant beyond the outermost ones.
    fn sample(&self, [x, y]: [f32; 2], scores: &mut [f32]) {
        let ((left, right, across), (above, below, down)) = (between(x, self.columns), between(y, self.rows));
        let (a, b) = (self.at(left, above), self.at(right, above));
        let (c, d) = (self.at(left, below), self.at(right, below));
        let weights =
            [(1.0 - across) * (1.0 - down), across * (1.0 - down), (1.0 - across) * down, across * down];
        for (index, score) in scores.iter_mut().enumerate() {
            *score =
                weights[0] * a[index] + weights[1] * b[index] + weights[2] * c[index] + weights[3] * d[index];
        }
    }
}

/// The two cells next to a place on a line of `count` cells, and its distance from the first.
fn between(place: f32, count: usize) -> (usize, usize, f32) {
    let inside = place.clamp(0.0, (count - 1) as f32);
    let first = inside.floor();
    (first as usize, (first as usize + 1).min(count - 1), inside - first)
}

impl Places<'_> {
    /// The class with the highest score of each pixel, the lowest in a tie; [`NO_ID`] if the pixel is in no view.
    pub fn classes(&self, scores: &[Scores<'_>]) -> Result<Vec<u16>> {
        let num_classes = self.check(scores)?;
        let cells: Vec<Vec<u16>> = scores.iter().map(Scores::highest).collect();
        let mut classes = vec![NO_ID; self.views.len()];
        classes.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, part)| {
            let mut sampled = vec![0.0; num_classes];
            for (offset, class) in part.iter_mut().enumerate() {
                let Some((view, place)) = self.seen(chunk * CHUNK + offset) else { continue };
                *class = scores[view].agreed(&cells[view], place).unwrap_or_else(|| {
                    scores[view].sample(place, &mut sampled);
                    highest(&sampled)
                });
            }
        });
        Ok(classes)
    }

    /// The share of each class of each pixel, in 1/255, pixel by pixel; zero if the pixel is in no view.
    ///
    /// Scores are logits, to which the softmax is applied, or already proportional to probabilities.
    pub fn shares(&self, scores: &[Scores<'_>], are_logits: bool) -> Result<Vec<u8>> {
        let num_classes = self.check(scores)?;
        let mut shares = vec![0; self.views.len() * num_classes];
        shares.par_chunks_mut(CHUNK * num_classes).enumerate().for_each(|(chunk, part)| {
            let mut sampled = vec![0.0; num_classes];
            for (offset, pixel) in part.chunks_exact_mut(num_classes).enumerate() {
                if let Some((view, place)) = self.seen(chunk * CHUNK + offset) {
                    scores[view].sample(place, &mut sampled);
                    write_shares(&mut sampled, are_logits, pixel);
                }
            }
        });
        Ok(shares)
    }

    fn check(&self, scores: &[Scores<'_>]) -> Result<usize> {
        let num_classes = scores.first().map_or(0, |first| first.num_classes);
        let is_known = |view: &u8| *view == NO_VIEW || usize::from(*view) < scores.len();
        if scores.iter().any(|scores| scores.num_classes != num_classes)
            || !self.views.par_iter().all(is_known)
        {
            return Err(Error::Input("views of an image: the scores do not match the views".into()));
        }
        Ok(num_classes.max(1))
    }

    fn seen(&self, index: usize) -> Option<(usize, [f32; 2])> {
        let (view, place) = (self.views[index], self.places[index]);
        let is_seen = view != NO_VIEW && place.iter().all(|x| x.is_finite());
        is_seen.then_some((usize::from(view), place))
    }
}

fn highest(scores: &[f32]) -> u16 {
    let mut best = 0;
    for (class, score) in scores.iter().enumerate() {
        if *score > scores[best] {
            best = class;
        }
    }
    best as u16
}

fn write_shares(scores: &mut [f32], are_logits: bool, shares: &mut [u8]) {
    if are_logits {
        let most = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        scores.iter_mut().for_each(|score| *score = (*score - most).exp());
    } else {
        scores.iter_mut().for_each(|score| *score = score.max(0.0));
    }
    let sum: f32 = scores.iter().sum();
    if sum > 0.0 {
        let scale = 255.0 / sum;
        shares.iter_mut().zip(scores).for_each(|(share, score)| *share = (*score * scale).round() as u8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn classes_first_and_last_are_the_same_scores() {
        let last = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0];
        let first = [1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0];
        let (a, b) = (Scores::classes_last(&last, (3, 2, 2)), Scores::classes_first(&first, (2, 3, 2)));
        assert_eq!(a.expect("whole").values, b.expect("whole").values);
    }

    #[test]
    fn between_two_cells_the_nearer_one_wins_and_outside_nothing_does() {
        let scores = [Scores::classes_last(&[1.0, 0.0, 0.0, 1.0], (1, 2, 2)).expect("whole")];
        let places = [[-3.0, 0.0], [0.4, 0.0], [0.6, 9.0], [0.0, 0.0], [f32::NAN, 0.0]];
        let seen = Places { views: &[0, 0, 0, NO_VIEW, 0], places: &places };
        assert_eq!(seen.classes(&scores).expect("known"), [0, 0, 1, NO_ID, NO_ID]);
        let shares = seen.shares(&scores, false).expect("known");
        assert_eq!(shares, [255, 0, 153, 102, 102, 153, 0, 0, 0, 0]);
    }

    #[test]
    fn what_is_not_finite_is_an_error() {
        assert!(Scores::classes_last(&[1.0, f32::NAN], (1, 1, 2)).is_err());
        assert!(Scores::classes_first(&[1.0, f32::INFINITY], (2, 1, 1)).is_err());
        assert!(Scores::classes_last(&[], (0, 1, 2)).is_err());
    }

    proptest! {
        #[test]
        fn what_four_cells_agree_on_is_the_highest_between_them(
            values in prop::collection::vec(0u8..4, 12), x in 0f32..1.0, y in 0f32..1.0,
        ) {
            let values: Vec<f32> = values.into_iter().map(f32::from).collect();
            let scores = Scores::classes_last(&values, (2, 2, 3)).expect("whole");
            let mut sampled = [0.0; 3];
            scores.sample([x, y], &mut sampled);
            if let Some(class) = scores.agreed(&scores.highest(), [x, y]) {
                let most = sampled.iter().copied().fold(f32::MIN, f32::max);
                prop_assert!(sampled[usize::from(class)] >= most);
            }
        }
    }
}
