//! Dense class ids, which replace the raw ids of points and pixels, and class shares of blocks of label images and
//! of network outputs. Shares are stored compactly: most items are of one class.

use rayon::prelude::*;

/// The id of points and pixels that carry no information.
pub const NO_CLASS: u8 = u8::MAX;

pub const NUM_IDS: usize = 1 << u16::BITS;

/// Flags the ids that occur in any of the frames.
pub fn seen_ids(frames: &[&[u16]]) -> Vec<bool> {
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

/// The class of each id, by a table with a class for every id.
pub fn look_up(ids: &[u16], table: &[u8; NUM_IDS]) -> Vec<u8> {
    ids.iter().map(|&id| table[usize::from(id)]).collect()
}

/// A class and its share of an item, in 1/255.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    pub class: u8,
    pub amount: u8,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClassShares {
    /// Index of the first entry of each item, plus one final index for the end.
    starts: Vec<u32>,
    entries: Vec<Share>,
}

impl Default for ClassShares {
    fn default() -> Self {
        Self { starts: vec![0], entries: Vec::new() }
    }
}

impl ClassShares {
    /// An empty collection with room for `num_items`.
    pub fn with_capacity(num_items: usize) -> Self {
        let mut shares = Self { starts: Vec::with_capacity(num_items + 1), entries: Vec::new() };
        shares.starts.push(0);
        shares
    }

    /// Items that are each entirely of one class, or of none.
    pub fn certain(classes: impl Iterator<Item = u8>) -> Self {
        let mut shares = Self::default();
        for class in classes {
            let share = (class != NO_CLASS).then_some(Share { class, amount: u8::MAX });
            shares.push_with(|entries| entries.extend(share));
        }
        shares
    }

    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The shares of an item, lowest class first.
    pub fn at(&self, index: usize) -> &[Share] {
        &self.entries[self.starts[index] as usize..self.starts[index + 1] as usize]
    }

    /// Reads where the shares of an item start, so that they are at hand when they are needed.
    pub fn touch(&self, index: usize) -> u8 {
        self.starts[index] as u8
    }

    pub fn entries(&self) -> &[Share] {
        &self.entries
    }

    /// Adds an item with the shares that `add` appends.
    pub fn push_with(&mut self, add: impl FnOnce(&mut Vec<Share>)) {
        add(&mut self.entries);
        self.starts.push(self.entries.len() as u32);
    }

    /// Adds an item whose classes `0..values.len()` have shares in proportion to `values`; none if the values sum
    /// to zero.
    pub fn push_proportional(&mut self, values: &[f32]) -> Result<(), f32> {
        if let Some(&wrong) = values.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
            return Err(wrong);
        }
        let sum = values.iter().sum::<f32>();
        if !sum.is_finite() {
            return Err(sum);
        }
        let scale = 255.0 / sum;
        self.push_with(|entries| {
            let amounts = values.iter().map(|value| (value * scale).round() as u8);
            let shares = amounts.enumerate().map(|(class, amount)| Share { class: class as u8, amount });
            entries.extend(shares.filter(|share| share.amount > 0));
        });
        Ok(())
    }

    /// Returns the same items with other classes: `table` maps each class to its new class, or to `NO_CLASS`, which
    /// drops its share. Shares of merged classes add up.
    pub fn renamed(&self, table: &[u8; 256]) -> Self {
        let mut renamed = Self::default();
        for index in 0..self.len() {
            renamed.push_with(|entries| {
                let begun = entries.len();
                for share in self.at(index) {
                    let class = table[usize::from(share.class)];
                    match entries[begun..].iter_mut().find(|other| other.class == class) {
                        _ if class == NO_CLASS => {}
                        Some(same) => same.amount = same.amount.saturating_add(share.amount),
                        None => entries.push(Share { class, ..*share }),
                    }
                }
                entries[begun..].sort_unstable_by_key(|share| share.class);
            });
        }
        renamed
    }

    /// The subset of items flagged by `keep`.
    pub fn kept(&self, keep: &[bool]) -> Self {
        let mut kept = Self::default();
        for (index, _) in keep.iter().enumerate().filter(|(_, is_kept)| **is_kept) {
            kept.push_with(|entries| entries.extend_from_slice(self.at(index)));
        }
        kept
    }

    /// The class with the largest share of each item, the lowest in a tie; `NO_CLASS` where less than half is
    /// labelled.
    pub fn classes(&self) -> Vec<u8> {
        let largest = |index: usize| {
            let shares = self.at(index);
            let labelled: u32 = shares.iter().map(|share| u32::from(share.amount)).sum();
            let most = shares.iter().max_by_key(|share| (share.amount, NO_CLASS - share.class));
            most.filter(|_| 2 * labelled >= 255).map_or(NO_CLASS, |share| share.class)
        };
        (0..self.len()).map(largest).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(rows: &[&[f32]]) -> ClassShares {
        let mut shares = ClassShares::default();
        rows.iter().for_each(|row| shares.push_proportional(row).expect("valid"));
        shares
    }

    #[test]
    fn probabilities_of_any_scale_become_shares() {
        let found = shares(&[&[0.2, 0.0, 0.8], &[51.0, 0.0, 204.0], &[0.0, 0.0, 0.0]]);
        let expected = [Share { class: 0, amount: 51 }, Share { class: 2, amount: 204 }];
        assert_eq!((found.at(0), found.at(1), found.at(2)), (&expected[..], &expected[..], &[][..]));
        assert_eq!(found.classes(), [2, 2, NO_CLASS]);
        assert_eq!(ClassShares::default().push_proportional(&[0.5, -0.5]), Err(-0.5));
        assert!(ClassShares::default().push_proportional(&[0.5, f32::NAN]).is_err());
    }

    #[test]
    fn classes_that_become_one_add_up() {
        let mut table = [NO_CLASS; 256];
        (table[0], table[1]) = (4, 4);
        let renamed = shares(&[&[0.2, 0.4, 0.4], &[0.1, 0.2, 0.7]]).renamed(&table);
        assert_eq!(renamed.at(0), [Share { class: 4, amount: 153 }]);
        // Most of the second item carries no information.
        assert_eq!(renamed.classes(), [4, NO_CLASS]);
    }
}
