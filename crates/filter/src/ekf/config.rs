//! How the filter works.

use crate::chi2;
use crate::covariance::Form;

/// How sightings find their landmarks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Association {
    /// By their labels.
    #[default]
    Known,
    /// Each to the nearest landmark within its gate, in the metric of the innovation; labels are not looked at.
    Nearest,
    /// All of an instant together, the largest set that is compatible as a whole (JCBB, Neira and Tardos 2001).
    Joint,
}

/// Where Jacobians are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Linearisation {
    /// At the latest estimates: the textbook filter. It believes to have observed its heading, and is overconfident.
    Latest,
    /// At the first estimates (Huang, Mourikis, Roumeliotis 2010): global position and heading stay unobservable.
    First,
    /// At the latest estimates, with errors that turn with the heading's (the invariant filter of Barrau and Bonnabel, "An
    /// EKF-SLAM algorithm with consistency properties", 2015): as consistent, and more exact after large corrections.
    #[default]
    Invariant,
}

/// Settings of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EkfConfig {
    /// Form of the covariance.
    pub form: Form,
    /// Where Jacobians are taken.
    pub linearisation: Linearisation,
    /// How sightings find their landmarks.
    pub association: Association,
    /// Part of the true sightings that the gate lets through; the bound is the chi-square quantile of as many degrees of
    /// freedom as are measured. 1 lets everything through.
    pub gate_probability: f64,
    /// Without labels: a sighting founds a new landmark only when it is outside this wider gate of all that there are.
    pub new_probability: f64,
    /// Without labels: sightings that make a provisional landmark a confirmed one.
    pub confirm_sightings: usize,
    /// Recover when at least this part of the last [`EkfConfig::recovery_window`] sightings was rejected; above 1 never.
    pub recovery_fraction: f64,
    /// Sightings that are looked back on.
    pub recovery_window: usize,
    /// Travel between two poses that are kept for a landmark that one measurement does not determine, in metres.
    pub delayed_spacing_m: f64,
    /// Keep landmarks within so many metres active and the rest passive; `None`: all active. At least twice the reach of
    /// the sensor: sightings of landmarks without labels farther than half of it are not used.
    pub local_radius_m: Option<f64>,
}

impl Default for EkfConfig {
    fn default() -> Self {
        Self {
            form: Form::Joseph,
            linearisation: Linearisation::First,
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
    /// The chi-square bound for so many degrees of freedom.
    pub fn gate(&self, dof: usize) -> f64 {
        chi2::quantile(self.gate_probability, dof)
    }

    /// The gate that lets as many true sightings through as this chi-square bound does with two degrees of freedom.
    pub fn with_gate_of_two(mut self, chi2: f64) -> Self {
        self.gate_probability = chi2::cumulative(chi2, 2);
        self
    }
}
