//! The hypotheses that the registration finds.

use crate::mutual_information::JointHistogram;
use crate::zoom::Placement;

/// A placement of the image on the sphere, with the agreement of the labels there.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Placement of the image.
    pub placement: Placement,
    /// Mutual information of the pooled histogram, nats, less its bias.
    pub mutual_information: f64,
    /// Number of labelled returns, among those used, on a labelled pixel, over all frames.
    pub num_pairs: f64,
    /// The pooled histogram.
    pub joint: JointHistogram,
}
