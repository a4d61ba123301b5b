use super::*;
use proptest::prelude::*;

/// The cells that an implementation finds, and its sums, cell by cell.
unsafe fn found<L: Lanes>(
    of: u32,
    lo: &[u16; 32],
    hi: &[u16; 32],
    (from, to): (u16, u16),
) -> (u32, [f32; 32]) {
    let values: [f32; 32] = std::array::from_fn(|i| 1.0 + i as f32);
    let weights: [f32; 32] = std::array::from_fn(|i| 32.0 - i as f32);
    let (mut bits, mut sums) = (0, [0.0; 32]);
    for at in (0..32).step_by(L::CELLS) {
        // SAFETY: the caller has detected the instructions, and there are 32 of everything.
        unsafe {
            let hits = L::hits(L::mask(of >> at), lo.as_ptr().add(at), hi.as_ptr().add(at), from, to);
            let mut sum = L::zero();
            L::add(&mut sum, values.as_ptr().add(at), hits);
            L::add_all(&mut sum, values.as_ptr().add(at));
            L::add_weighted(&mut sum, values.as_ptr().add(at), weights.as_ptr().add(at), hits);
            L::store(sum, sums.as_mut_ptr().add(at));
            assert_eq!(L::is_none(hits), L::bits(hits) == 0);
            let left = L::without(L::mask(of >> at), hits);
            assert_eq!(L::bits(L::union(left, hits)), L::bits(L::mask(of >> at)));
            bits |= L::bits(hits) << at;
        }
    }
    (bits, sums)
}

proptest! {
    #[test]
    fn lanes_find_and_add_what_the_comparison_says(
        of in any::<u32>(),
        cells in prop::collection::vec((0u16..9, 0u16..9), 32),
        far in any::<bool>(),
        from in 1u16..8,
        codes in 1u16..8,
    ) {
        // Codes at both ends of their range, where signed and unsigned order differ.
        let code = |code: u16| if far && code > 0 { u16::MAX - 16 + code } else { code };
        let lo: [u16; 32] = std::array::from_fn(|i| code(cells[i].0.min(cells[i].1)));
        let hi: [u16; 32] = std::array::from_fn(|i| code(cells[i].0.max(cells[i].1)));
        let (from, to) = (code(from), code(from + codes));
        let met = |i: &usize| of >> i & 1 != 0 && hi[*i] >= from && lo[*i] < to;
        let bits = (0..32).filter(met).fold(0u32, |bits, i| bits | 1 << i);
        let value = |i: usize| (1 + i) as f32 * if bits >> i & 1 != 0 { 34.0 - i as f32 } else { 1.0 };
        let expected = (bits, std::array::from_fn(value));
        // SAFETY: needs nothing.
        prop_assert_eq!(unsafe { found::<Portable>(of, &lo, &hi, (from, to)) }, expected);
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: detected.
            prop_assert_eq!(unsafe { found::<Avx2>(of, &lo, &hi, (from, to)) }, expected);
        }
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw") {
            // SAFETY: detected.
            prop_assert_eq!(unsafe { found::<Avx512>(of, &lo, &hi, (from, to)) }, expected);
        }
    }
}
