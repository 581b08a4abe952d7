//! Which instruction set the inner loops use; all give bit-identical results.

/// An implementation of the inner loops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Plain Rust.
    Scalar,
    /// Eight lanes, and instructions for bits.
    Avx2,
    /// Sixteen lanes.
    Avx512,
}

impl Backend {
    /// All backends, slowest first.
    pub const ALL: [Self; 3] = [Self::Scalar, Self::Avx2, Self::Avx512];

    /// Whether this processor has the instructions.
    pub fn available(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The fastest available backend.
    pub fn best() -> Self {
        let available = Self::ALL.into_iter().rev().find(|b| b.available());
        available.unwrap_or(Self::Scalar)
    }
}

impl Default for Backend {
    fn default() -> Self {
        Self::best()
    }
}

/// Runs an `#[inline(always)]` function compiled for a backend's instruction set: the same operations in the same
/// order (no fused multiply-add), so the same bits.
macro_rules! dispatch {
    ($backend:expr, $f:ident($($a:ident: $t:ty),* $(,)?) -> $r:ty) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
            fn avx2($($a: $t),*) -> $r {
                $f($($a),*)
            }
            #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512dq,bmi1,bmi2,popcnt")]
            fn avx512($($a: $t),*) -> $r {
                $f($($a),*)
            }
            match $backend {
                $crate::Backend::Scalar => $f($($a),*),
                #[allow(unsafe_code)]
                // SAFETY: a backend is only chosen when the processor has its instructions.
                $crate::Backend::Avx2 => unsafe { avx2($($a),*) },
                #[allow(unsafe_code)]
                // SAFETY: as above.
                $crate::Backend::Avx512 => unsafe { avx512($($a),*) },
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = $backend;
            $f($($a),*)
        }
    }};
}
pub(crate) use dispatch;
