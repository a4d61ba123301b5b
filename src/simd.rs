//! Instruction sets, chosen at run time.

/// The instruction sets for which there are code paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InstructionSet {
    /// The baseline of every processor of this architecture.
    Portable,
    /// 256-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors with masks.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// Whether this processor supports it.
    fn is_detected(self) -> bool {
        match self {
            InstructionSet::Portable => true,
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
        }
    }
}

/// A proof that this processor supports an instruction set: no value exists for one that was not detected. All
/// instruction sets give the same bits: the compiler neither reorders sums nor fuses multiplications into them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Simd(InstructionSet);

impl Simd {
    /// The baseline of every processor of this architecture.
    pub const PORTABLE: Simd = Simd(InstructionSet::Portable);

    /// All names, the best last.
    pub const NAMES: &[&str] = &[
        "portable",
        #[cfg(target_arch = "x86_64")]
        "avx2",
        #[cfg(target_arch = "x86_64")]
        "avx512",
    ];

    /// All instruction sets that this processor supports, the best last.
    pub fn available() -> Vec<Simd> {
        let all = [
            InstructionSet::Portable,
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2,
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512,
        ];
        all.into_iter().filter(|set| set.is_detected()).map(Simd).collect()
    }

    /// One of [`Simd::NAMES`].
    pub fn name(self) -> &'static str {
        Simd::NAMES[self.0 as usize]
    }

    /// The instruction set that was detected.
    pub(crate) fn instruction_set(self) -> InstructionSet {
        self.0
    }

    /// Runs `work`, compiled for this instruction set.
    ///
    /// Only code that is inlined is compiled for it. A closure that is not trivial must be passed as
    /// `#[inline(always)] || ..`, and all functions that it calls must be marked likewise. A closure that the
    /// compiler does not inline is compiled once, for the baseline.
    #[inline(always)]
    pub fn run<T>(self, work: impl FnOnce() -> T) -> T {
        match self.0 {
            InstructionSet::Portable => work(),
            // SAFETY: the instructions have been detected, otherwise this value would not exist.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { avx512(work) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn avx2<T>(work: impl FnOnce() -> T) -> T {
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
unsafe fn avx512<T>(work: impl FnOnce() -> T) -> T {
    work()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_processor_runs_the_portable_code_and_names_are_in_order() {
        let available = Simd::available();
        assert_eq!(available[0], Simd::PORTABLE);
        for simd in available {
            assert_eq!(simd.run(|| simd.name()), Simd::NAMES[simd.instruction_set() as usize]);
            assert_eq!(format!("{:?}", simd.instruction_set()).to_lowercase(), simd.name());
        }
    }
}
