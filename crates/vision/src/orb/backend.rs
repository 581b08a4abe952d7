//! Which instructions the hot loops use; found once, at run time.

/// Instruction set of the hot loops. All give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Plain Rust, any machine.
    Scalar,
    /// 256-bit integer instructions of x86-64.
    Avx2,
}

impl Backend {
    /// The fastest that this machine has.
    pub fn detect() -> Self {
        if Self::Avx2.available() { Self::Avx2 } else { Self::Scalar }
    }

    /// True when this machine can run it.
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
