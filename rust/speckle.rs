//! Isolated wrong labels of a picture, mended by their neighbours.
//!
//! A label that hardly any neighbour shares says nothing of where a border runs, and each such pixel would pull at every
//! point beside it. Wires and poles one pixel wide keep their labels, but for the pixel at either end: along them, two of
//! eight neighbours agree.

use crate::label_image::LabelImage;
use crate::observation::NO_CLASS;

/// A pixel is isolated if no more than this number of its eight neighbours have its class.
const MOST_ALIKE: usize = 1;

/// Gives isolated pixels the class that most of their neighbours have that are not isolated themselves (the lowest class
/// of several; its own if there is none), and counts the isolated pixels.
pub fn despeckled(image: &LabelImage<u8>) -> (LabelImage<u8>, usize) {
    let isolated: Vec<bool> = (0..image.ids.len()).map(|index| is_isolated(image, index)).collect();
    let count = isolated.iter().filter(|&&is_isolated| is_isolated).count();
    let mended = |index: usize| {
        let id = image.ids[index];
        if !isolated[index] {
            return id;
        }
        let mut found = [NO_CLASS; 8];
        let sound = neighbours(image, index).filter(|&i| !isolated[i] && image.ids[i] != NO_CLASS);
        let count = found.iter_mut().zip(sound).map(|(class, i)| *class = image.ids[i]).count();
        let classes = &found[..count];
        let votes = |class: u8| classes.iter().filter(|&&c| c == class).count();
        classes.iter().copied().max_by_key(|&class| (votes(class), NO_CLASS - class)).unwrap_or(id)
    };
    let ids = (0..image.ids.len()).map(mended).collect();
    (LabelImage { ids, ..*image }, count)
}

fn is_isolated(image: &LabelImage<u8>, index: usize) -> bool {
    let id = image.ids[index];
    let alike = neighbours(image, index).filter(|&i| image.ids[i] == id);
    id != NO_CLASS && alike.take(MOST_ALIKE + 1).count() <= MOST_ALIKE
}

/// The indices of the up to eight pixels around one.
#[inline]
fn neighbours(image: &LabelImage<u8>, index: usize) -> impl Iterator<Item = usize> {
    let (width, height) = (image.width, image.height);
    let (u, v) = (index % width, index / width);
    AROUND.iter().filter_map(move |&(right, down)| {
        let (u, v) = (u.wrapping_add_signed(right), v.wrapping_add_signed(down));
        (u < width && v < height).then_some(v * width + u)
    })
}

const AROUND: [(isize, isize); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

#[cfg(test)]
mod tests {
    use super::*;

    fn mend(width: usize, rows: &[&[u8]]) -> (Vec<u8>, usize) {
        let image = LabelImage { width, height: rows.len(), ids: rows.concat() };
        let (mended, count) = despeckled(&image);
        (mended.ids, count)
    }

    #[test]
    fn an_isolated_pixel_takes_the_class_around_it() {
        let (ids, count) = mend(4, &[&[1, 1, 2, 2], &[1, 7, 2, 2], &[1, 1, 2, 2]]);
        assert_eq!((ids, count), ([1, 1, 2, 2].repeat(3), 1));
    }

    #[test]
    fn a_line_one_pixel_wide_stays_as_it_is() {
        let rows: [&[u8]; 4] = [&[0, 5, 0, 0], &[0, 5, 0, 0], &[0, 5, 0, 0], &[0, 5, 0, 0]];
        let (ids, _) = mend(4, &rows);
        assert_eq!(ids[4..12], rows.concat()[4..12]);
    }

    #[test]
    fn pixels_without_a_class_neither_give_nor_take() {
        const N: u8 = NO_CLASS;
        let (ids, count) = mend(3, &[&[N, N, N], &[N, 3, N], &[N, N, N]]);
        assert_eq!((ids, count), (vec![N, N, N, N, 3, N, N, N, N], 1));
        let (ids, _) = mend(3, &[&[4, 4, 4], &[4, N, 4], &[4, 4, 4]]);
        assert_eq!(ids[4], N);
    }
}
