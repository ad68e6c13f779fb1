//! Thinning of items, where more would cost time and add no information.

/// The stride that leaves about `most` of `count` items, and never many more.
pub fn stride(count: usize, most: usize) -> usize {
    count.div_ceil(most).max(1)
}

/// One index of every `stride`, each at a scattered position within its stride: a fixed step would alias with the
/// channels of a sweep.
pub fn thinned(count: usize, stride: usize) -> impl Iterator<Item = usize> {
    (0..count.div_ceil(stride))
        .map(move |k| k * stride + scattered(k as u64, stride))
        .filter(move |&i| i < count)
}

/// A pseudo-random number below `limit` (splitmix64, by Steele, Lea and Flood, 2014).
fn scattered(k: u64, limit: usize) -> usize {
    let mut z = (k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) % limit as u64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_is_left_whatever_the_step() {
        for step in [2, 16, 64] {
            let mut channels = [0; 64];
            thinned(64 * 2000, step).for_each(|i| channels[i % 64] += 1);
            let expected = 2000.0 / step as f64;
            assert!(channels.iter().all(|&n| (f64::from(n) - expected).abs() < 6.0 * expected.sqrt()));
        }
    }
}
