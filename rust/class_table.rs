//! Raw ids of labels, of which few of all that there could be occur, and the dense classes that replace them.

use rayon::prelude::*;

/// Number of ids that there could be.
pub const NUM_IDS: usize = 1 << u16::BITS;

/// Which ids occur in any of the frames.
pub fn seen(frames: &[&[u16]]) -> Vec<bool> {
    let none = || vec![false; NUM_IDS];
    let of_frame = |mut seen: Vec<bool>, ids: &&[u16]| {
        ids.iter().for_each(|&id| seen[usize::from(id)] = true);
        seen
    };
    let either = |mut a: Vec<bool>, b: Vec<bool>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a |= b);
        a
    };
    frames.par_iter().fold(none, of_frame).reduce(none, either)
}

/// The class of each id, by a table of the classes of all ids.
pub fn look_up(ids: &[u16], table: &[u8; NUM_IDS]) -> Vec<u8> {
    ids.iter().map(|&id| table[usize::from(id)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_all_frames_are_seen_and_looked_up() {
        let frames: [&[u16]; 3] = [&[3, 3, 65535], &[], &[0]];
        let found = seen(&frames);
        let ids: Vec<usize> = (0..NUM_IDS).filter(|&id| found[id]).collect();
        assert_eq!(ids, [0, 3, 65535]);
        let mut table = [9; NUM_IDS];
        (table[3], table[65535]) = (1, 2);
        assert_eq!(look_up(frames[0], &table), [1, 1, 2]);
    }
}
