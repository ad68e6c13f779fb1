//! Replacement of isolated wrong labels in a label image by those of their neighbours.
//!
//! A label that hardly any neighbour shares carries no information on a border, and each such pixel would pull at
//! every point next to it. Wires and poles one pixel wide keep their labels, except for the pixel at either end:
//! along them, two of eight neighbours agree.

use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;

/// A pixel is isolated if at most this many of its eight neighbours have its class.
const MAX_ALIKE: u8 = 1;

/// Replaces the class of each isolated pixel by the majority class of its neighbours that are not isolated
/// themselves (the lowest in a tie; its own if there is none), and counts the isolated pixels.
pub fn despeckled(image: &LabelImage<u8>) -> (LabelImage<u8>, usize) {
    let isolated = isolated(image);
    let mut ids = image.ids.clone();
    let mut count = 0;
    for index in (0..ids.len()).filter(|&index| isolated[index]) {
        let mut found = [NO_CLASS; 8];
        let sound = neighbours(image, index).filter(|&i| !isolated[i] && image.ids[i] != NO_CLASS);
        let num_sound = found.iter_mut().zip(sound).map(|(class, i)| *class = image.ids[i]).count();
        let classes = &found[..num_sound];
        let votes = |class: u8| classes.iter().filter(|&&c| c == class).count();
        let most = classes.iter().copied().max_by_key(|&class| (votes(class), NO_CLASS - class));
        ids[index] = most.unwrap_or(ids[index]);
        count += 1;
    }
    (LabelImage { ids, ..*image }, count)
}

fn isolated(image: &LabelImage<u8>) -> Vec<bool> {
    let (width, height) = (image.width, image.height);
    let line = |v: usize| &image.ids[v * width..][..width];
    let mut isolated = Vec::with_capacity(image.ids.len());
    let mut alike = vec![0u8; width];
    for v in 0..height {
        alike.fill(0);
        // Whole lines against shifted lines, which compilers vectorise.
        for (right, down) in AROUND {
            let Some(other) = v.checked_add_signed(down).filter(|&v| v < height).map(line) else { continue };
            let (from, to) = (usize::from(right < 0), width - usize::from(right > 0));
            let shifted = &other[from.wrapping_add_signed(right)..];
            for ((count, a), b) in alike[from..to].iter_mut().zip(&line(v)[from..to]).zip(shifted) {
                *count += u8::from(a == b);
            }
        }
        let is_isolated = |(&count, &id): (&u8, &u8)| count <= MAX_ALIKE && id != NO_CLASS;
        isolated.extend(alike.iter().zip(line(v)).map(is_isolated));
    }
    isolated
}

fn neighbours(image: &LabelImage<u8>, index: usize) -> impl Iterator<Item = usize> {
    let (width, height) = (image.width, image.height);
    let (u, v) = (index % width, index / width);
    AROUND.into_iter().filter_map(move |(right, down)| {
        let (u, v) = (u.wrapping_add_signed(right), v.wrapping_add_signed(down));
        (u < width && v < height).then_some(v * width + u)
    })
}

const AROUND: [(isize, isize); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

#[cfg(test)]
mod tests {
    use super::*;

    fn despeckle(width: usize, rows: &[&[u8]]) -> (Vec<u8>, usize) {
        let image = LabelImage { width, height: rows.len(), ids: rows.concat() };
        let (despeckled_image, count) = despeckled(&image);
        (despeckled_image.ids, count)
    }

    #[test]
    fn an_isolated_pixel_takes_the_class_around_it() {
        let (ids, count) = despeckle(4, &[&[1, 1, 2, 2], &[1, 7, 2, 2], &[1, 1, 2, 2]]);
        assert_eq!((ids, count), ([1, 1, 2, 2].repeat(3), 1));
    }

    #[test]
    fn a_line_one_pixel_wide_stays_as_it_is() {
        let rows: [&[u8]; 4] = [&[0, 5, 0, 0], &[0, 5, 0, 0], &[0, 5, 0, 0], &[0, 5, 0, 0]];
        let (ids, _) = despeckle(4, &rows);
        assert_eq!(ids[4..12], rows.concat()[4..12]);
    }

    #[test]
    fn pixels_without_a_class_neither_give_nor_take() {
        const N: u8 = NO_CLASS;
        let (ids, count) = despeckle(3, &[&[N, N, N], &[N, 3, N], &[N, N, N]]);
        assert_eq!((ids, count), (vec![N, N, N, N, 3, N, N, N, N], 1));
        let (ids, _) = despeckle(3, &[&[4, 4, 4], &[4, N, 4], &[4, 4, 4]]);
        assert_eq!(ids[4], N);
    }
}
