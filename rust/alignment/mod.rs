//! Mutual information over SE(3): its value and gradient at a pose, at one level of the label pyramid (Alg. 1).
//!
//! A point distributes its weight over the four blocks around it (partial volume), so that the joint histogram changes
//! smoothly with the pose. For discrete labels the Donsker-Varadhan bound is attained by
//! `F(x, y) = log p(x, y) / (p(x) p(y))`, a table, so this is the limit of MINE. For soft labels it is the mutual
//! information of ids drawn from the shares, a lower bound.
//!
//! Overlap: points are chosen and weighted at an anchor pose. While they project, they keep counting when they
//! leave the image, with the class at the nearest border: a pose cannot raise the objective by pushing points out.
//!
//! Where points have partitions, the rows of the histogram are their segments, and the adjusted mutual information
//! is maximised: see `adjusted.rs` and [`crate::observation::Partitions`].

mod adjusted;
mod anchored;
mod ascent;
mod information;
mod joint;
#[cfg(test)]
mod joint_tests;
mod level;
mod lines;
mod newton;
mod objective;
mod projection;
mod sample;
mod selection;
mod sensitivity;
mod slopes;
#[cfg(test)]
mod test_scene;
mod variables;

pub use anchored::{Anchored, MiniBatch};
pub use ascent::{AlignmentConfig, Ascended, align, ascend};
pub use information::{information, information_gains};
pub use joint::{AscentConfig, JointMaximum, maximise};
pub use lines::{Line, information_along};
pub use objective::Objective;
pub use sample::Counted;
pub use sensitivity::{Sensitivity, SensitivityConfig, sensitivity};
pub use variables::{MAX_VARIABLES, Variables};
