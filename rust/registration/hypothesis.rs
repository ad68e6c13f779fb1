//! What the registration finds.

use crate::mutual_information::JointHistogram;
use crate::zoom::Placement;

/// A placement of the picture on the sphere, and how well labels agree there.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Where the picture lies.
    pub placement: Placement,
    /// Mutual information of the pooled histogram, nats, less its bias.
    pub mutual_information: f64,
    /// Labelled returns, of those that were looked at, that fall on a labelled pixel, over all frames.
    pub num_pairs: f64,
    /// The pooled histogram.
    pub joint: JointHistogram,
}
