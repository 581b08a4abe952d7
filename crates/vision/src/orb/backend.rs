//! Instruction set of the hot loops, detected at run time.

/// Instruction set of the hot loops. All give bit-identical results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Portable Rust.
    Scalar,
    /// 256-bit integer instructions (AVX2) of x86-64.
    Avx2,
    /// 512-bit integer instructions of x86-64 (AVX-512 F, BW, VL, VBMI and VNNI: Ice Lake, Zen 4 and later), with
    /// AVX2 where they bring nothing.
    Avx512,
}

impl Backend {
    /// The fastest backend available on this machine.
    pub fn detect() -> Self {
        [Self::Avx512, Self::Avx2].into_iter().find(|b| b.available()).unwrap_or(Self::Scalar)
    }

    /// True when this machine supports it.
    pub fn available(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512vbmi")
                    && is_x86_feature_detected!("avx512vnni")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
        }
    }

    /// True when AVX2 is part of it.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn has_avx2(self) -> bool {
        self != Self::Scalar
    }

    /// All that this machine can run, for tests.
    #[cfg(test)]
    pub(crate) fn every() -> Vec<Self> {
        [Self::Scalar, Self::Avx2, Self::Avx512].into_iter().filter(|b| b.available()).collect()
    }
}
