//! Configuration of the filter.

use crate::chi2;

/// A sighting beyond this part of the right ones speaks against the pose, or is an outlier.
pub(super) const FAR: f64 = 0.999;

/// How sightings are associated with landmarks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Association {
    /// By their labels.
    #[default]
    Known,
    /// Each to the nearest landmark within its gate, by the Mahalanobis distance of the innovation; labels are ignored.
    Nearest,
    /// All sightings of an instant together: the largest jointly compatible set (JCBB, Neira and Tardos 2001).
    Joint,
    /// As `Joint`, but where several answers are likely each is followed until later sightings decide
    /// ([`super::Hypotheses`]).
    Deferred,
}

/// Where Jacobians are evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Linearisation {
    /// At the latest estimates: the textbook filter. It gains false information about its heading and becomes
    /// overconfident.
    Latest,
    /// At the first estimates (Huang, Mourikis, Roumeliotis 2010): global position and heading stay unobservable.
    First,
    /// At the latest estimates, with errors that turn with the heading error (the invariant filter of Barrau and
    /// Bonnabel, "An EKF-SLAM algorithm with consistency properties", 2015): as consistent as `First`, and more exact
    /// after large corrections.
    #[default]
    Invariant,
}

/// Configuration of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EkfConfig {
    /// Where Jacobians are evaluated; [`super::Hypotheses`] without labels: those of the map. Its associations use first
    /// estimates.
    pub linearisation: Linearisation,
    /// How sightings are associated with landmarks.
    pub association: Association,
    /// Fraction of correct sightings that the gate accepts; the bound is the chi-square quantile with as many degrees
    /// of freedom as are measured. 1 accepts everything.
    pub gate_probability: f64,
    /// Without labels: a sighting starts a new landmark only when it is outside this wider gate of all existing
    /// landmarks.
    pub new_probability: f64,
    /// Without labels: number of sightings after which a tentative landmark is confirmed.
    pub confirm_sightings: usize,
    /// Recover when at least this fraction of the last [`EkfConfig::recovery_window`] sightings was rejected; never if
    /// above 1.
    pub recovery_fraction: f64,
    /// Number of recent sightings that are considered.
    pub recovery_window: usize,
    /// Distance travelled between two poses stored for a landmark that one measurement does not determine, in metres.
    pub delayed_spacing_m: f64,
    /// Keep landmarks within this distance active and the rest passive; `None`: all active. It must be at least twice
    /// the range of the sensor: unlabelled sightings of landmarks farther than half of it are not used.
    pub local_radius_m: Option<f64>,
}

impl Default for EkfConfig {
    fn default() -> Self {
        Self {
            linearisation: Linearisation::Invariant,
            association: Association::Known,
            gate_probability: 0.999,
            new_probability: 0.999_99,
            confirm_sightings: 3,
            recovery_fraction: 0.5,
            recovery_window: 10,
            delayed_spacing_m: 0.5,
            local_radius_m: None,
        }
    }
}

impl EkfConfig {
    /// The chi-square bound for this number of degrees of freedom.
    pub fn gate(&self, dof: usize) -> f64 {
        chi2::quantile(self.gate_probability, dof)
    }

    /// Sets the gate so that it accepts as many correct sightings as this chi-square bound does with two degrees of
    /// freedom.
    pub fn with_gate_of_two(mut self, chi2: f64) -> Self {
        self.gate_probability = chi2::cumulative(chi2, 2);
        self
    }
}
