//! Instruction sets, chosen when the program runs.

/// An instruction set to compute with. All give the same bits: the compiler neither reorders sums nor fuses
/// products into them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Simd {
    /// What every processor of this kind has.
    Portable,
    /// 256-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors with masks.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Simd {
    /// All that this processor can run, best last.
    pub fn available() -> Vec<Simd> {
        let mut all = vec![Simd::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") {
                all.push(Simd::Avx2);
            }
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                all.push(Simd::Avx512);
            }
        }
        all
    }

    /// The same with vectors of at most 256 bits: for loops whose sums fill the registers, which wider ones make slower.
    pub fn narrow(self) -> Simd {
        match self {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => Simd::Avx2,
            other => other,
        }
    }

    /// Does `work`, compiled for this instruction set: a loop without calls that are not inlined.
    #[inline(always)]
    pub fn run<T>(self, work: impl FnOnce() -> T) -> T {
        match self {
            Simd::Portable => work(),
            // SAFETY: values of these come from `available`, which detects the instructions.
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => unsafe { avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => unsafe { avx512(work) },
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

/// Compiles a function of plain code once for each instruction set; the first argument of what comes out picks one.
///
/// Rust never contracts a product and a sum into one rounding, so that all of them give the same bits.
macro_rules! multiversion {
    ($(#[$meta:meta])* $visible:vis fn $name:ident $(<const $n:ident: usize>)? ($($arg:ident: $type:ty),* $(,)?)
        $body:block) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments, reason = "the instruction set is one more than the function has")]
        $visible fn $name $(<const $n: usize>)? (simd: $crate::cpu::simd::Simd, $($arg: $type),*) {
            use $crate::cpu::simd::Simd;

            #[inline(always)]
            fn portable $(<const $n: usize>)? ($($arg: $type),*) $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn avx2 $(<const $n: usize>)? ($($arg: $type),*) {
                portable $(::<$n>)? ($($arg),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
            fn avx512 $(<const $n: usize>)? ($($arg: $type),*) {
                portable $(::<$n>)? ($($arg),*)
            }

            match simd {
                Simd::Portable => portable $(::<$n>)? ($($arg),*),
                #[cfg(target_arch = "x86_64")]
                // SAFETY: values of `Simd` come from `Simd::available`, which detects the instructions.
                Simd::Avx2 => unsafe { avx2 $(::<$n>)? ($($arg),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: as above.
                Simd::Avx512 => unsafe { avx512 $(::<$n>)? ($($arg),*) },
            }
        }
    };
}
pub(crate) use multiversion;
