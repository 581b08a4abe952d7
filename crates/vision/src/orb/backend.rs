//! Instruction set of the hot loops, detected at run time.

/// Instruction set of the hot loops. All give bit-identical results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Portable Rust.
    Scalar,
    /// 256-bit integer instructions (AVX2) of x86-64.
    Avx2,
}

impl Backend {
    /// The fastest backend available on this machine.
    pub fn detect() -> Self {
        if Self::Avx2.available() { Self::Avx2 } else { Self::Scalar }
    }

    /// True when this machine supports it.
    pub fn available(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 => false,
        }
    }
}
