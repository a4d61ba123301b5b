//! Openings of every kind: their lens points, their kernels, and the agreement of both.

use super::*;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// An opening of every kind, with the second moments of its light about its centre, across and down.
fn openings() -> Vec<(Aperture, Option<[f64; 2]>)> {
    let hexagon = || Aperture::new(6, 10.0, None).unwrap();
    let disc = || Aperture::DISC;
    // Second moment per axis of a regular polygon of circumradius 1.
    let six = (2.0 + (TAU / 6.0).cos()) / 12.0;
    let checks = Picture::new(2, &[0.0, 1.0, 1.0, 0.0]).unwrap();
    vec![
        (disc(), Some([0.25; 2])),
        (hexagon(), Some([six; 2])),
        // The Gaussian is truncated far out.
        (Aperture::new(0, 0.0, Some(0.25)).unwrap(), Some([0.0625; 2])),
        (hexagon().with_ratio(2.0).unwrap(), Some([six / 4.0, six])),
        (disc().with_ratio(0.5).unwrap(), Some([0.25, 0.0625])),
        // Disc minus disc: (1 - o^4) / (1 - o^2) / 4.
        (disc().with_obstruction(0.5).unwrap(), Some([0.3125; 2])),
        (hexagon().with_roundness(1.0).unwrap(), Some([0.25; 2])),
        (hexagon().with_roundness(0.3).unwrap(), None),
        (Aperture::of_picture(checks), Some([0.25; 2])),
        (disc().leaning([0.1, -0.2]), None),
    ]
}

#[test]
fn lens_points_have_the_moments_of_the_opening() {
    for (aperture, moments) in openings() {
        let points = aperture.lens_points(512, Side::Behind);
        assert!(points.iter().all(|p| p[0].hypot(p[1]) <= 1.0 + 1e-9), "{aperture:?}");
        let Some(moments) = moments else { continue };
        for axis in 0..2 {
            let mean = points.iter().map(|p| p[axis]).sum::<f64>() / 512.0;
            let second = points.iter().map(|p| p[axis] * p[axis]).sum::<f64>() / 512.0;
            assert!(mean.abs() < 4e-3, "{aperture:?}: mean {mean}");
            assert!((second - moments[axis]).abs() < 1e-3 + 5e-3 * moments[axis], "{aperture:?}: {second}");
        }
    }
}

/// Mean and second moments of a kernel in units of its radius, with the moments of a pixel subtracted.
fn moments(kernel: &Kernel, r: f64) -> [f64; 4] {
    let mut sums = [0.0; 4];
    for (dx, dy, w) in kernel.weights() {
        let (x, y, w) = (f64::from(dx) / r, f64::from(dy) / r, f64::from(w));
        sums = [sums[0] + w * x, sums[1] + w * y, sums[2] + w * x * x, sums[3] + w * y * y];
    }
    let pixel = 1.0 / (12.0 * r * r);
    [sums[0], sums[1], sums[2] - pixel, sums[3] - pixel]
}

#[test]
fn kernels_and_lens_points_are_of_one_opening() {
    let aberrated = Aperture::DISC.with_spherical(0.6).unwrap();
    let openings = openings().into_iter().map(|o| o.0).chain([aberrated]);
    for aperture in openings {
        for t in [7.3, -25.0] {
            let points = aperture.lens_points(16_384, Side::of(t));
            let of_points = |f: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(f).sum::<f64>() / 16_384.0;
            let expected = [
                t.signum() * of_points(&|p| p[0]),
                t.signum() * of_points(&|p| p[1]),
                of_points(&|p| p[0] * p[0]),
                of_points(&|p| p[1] * p[1]),
            ];
            let found = moments(&aperture.kernel(t), t.abs());
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1.5e-3, "{aperture:?} {t}: {found} against {expected}");
            }
        }
    }
}

#[test]
fn aberration_has_a_bright_rim_behind_the_focus_and_a_soft_one_in_front() {
    let aperture = Aperture::DISC.with_spherical(0.5).unwrap();
    let ratio = |t: f64| {
        let kernel = aperture.kernel(t);
        let weight = |x: i32| kernel.weights().find(|w| (w.0, w.1) == (x, 0)).map_or(0.0, |w| f64::from(w.2));
        weight(28) / weight(0)
    };
    // The density at rho is 1 + s (2 rho^2 - 1), with the sign of s reversed in front.
    let density = |s: f64, rho: f64| 1.0 + s * (2.0 * rho * rho - 1.0);
    for (t, s) in [(-30.0, 0.5), (30.0, -0.5)] {
        let expected = density(s, 28.0 / 30.0) / density(s, 0.0);
        assert!((ratio(t) / expected - 1.0).abs() < 0.03, "{t}: {} against {expected}", ratio(t));
    }
}

#[test]
fn rows_of_a_kernel_follow_one_another() {
    let slits = Picture::new(1, &[1.0, 0.0, 0.0, 0.0, 1.0]).unwrap();
    let openings = openings().into_iter().map(|o| o.0).chain([Aperture::of_picture(slits)]);
    for aperture in openings {
        for t in [0.2, 0.6, 0.9, 1.3, 2.2, 4.1, -7.3, -25.0] {
            for kernel in [aperture.kernel(t), aperture.transfer_kernel(t)] {
                let first = kernel.rows[0].dy;
                for (i, row) in kernel.rows.iter().enumerate() {
                    assert_eq!(row.dy, first + i as i32, "{aperture:?} {t}");
                }
            }
        }
    }
}

/// `2 J1(x) / x`, as the mean of a cosine over a disc.
fn disc_transfer(x: f64) -> f64 {
    const CHORDS: usize = 4096;
    let chord = |i: usize| (i as f64 + 0.5) / CHORDS as f64;
    let (sum, all) = (0..CHORDS).map(chord).fold((0.0, 0.0), |(sum, all), u| {
        let width = (1.0 - u * u).sqrt();
        (sum + width * (x * u).cos(), all + width)
    });
    sum / all
}

#[test]
fn fitted_kernels_have_the_transfer_function_of_the_disc() {
    for t in [0.1, 0.25, 0.5, 0.6, 0.75, 0.9, 1.0, 1.2, 1.5, 2.0, 2.7, 3.3, 4.0, 4.6, 5.5] {
        let kernel = Aperture::DISC.transfer_kernel(t);
        for period in [4.0, 5.0, 6.5, 9.0, 16.0, 40.0] {
            for angle in [0.0, 0.4, 0.785] {
                let w = 2.0 * PI / period;
                let [wx, wy] = [w * f64::cos(angle), w * f64::sin(angle)];
                let left: f64 = kernel
                    .weights()
                    .map(|(x, y, weight)| f64::from(weight) * (wx * f64::from(x) + wy * f64::from(y)).cos())
                    .sum();
                // Without negative weights, diagonals cannot be fitted quite as well.
                let tolerance = if angle == 0.0 { 0.0095 } else { 0.0125 };
                let error = left - disc_transfer(w * t);
                assert!(error.abs() < tolerance, "{t} px, period {period}, {angle}: {error}");
            }
        }
    }
}

#[test]
fn fitted_kernels_grow_smoothly_and_stay_symmetric() {
    let weights = |t: f64| {
        let kernel = Aperture::DISC.transfer_kernel(t);
        move |x: i32, y: i32| kernel.weights().find(|w| (w.0, w.1) == (x, y)).map_or(0.0, |w| w.2)
    };
    for i in 1..120 {
        let t = f64::from(i) * 0.05;
        let (here, next) = (weights(t), weights(t + 1e-3));
        for (x, y) in (-8..=8).flat_map(|y| (-8..=8).map(move |x| (x, y))) {
            assert!((here(x, y) - next(x, y)).abs() < 6e-3, "{t}: {} to {}", here(x, y), next(x, y));
            for (x2, y2) in [(-x, y), (y, x), (-y, x)] {
                assert!((here(x, y) - here(x2, y2)).abs() < 1e-5, "{t} at {x}, {y}");
            }
        }
    }
}

#[test]
fn kernels_sum_to_one_and_small_ones_are_the_identity() {
    for (aperture, _) in openings() {
        for t in [-9.5, -0.3, 0.0, 0.3, 0.5, 1.0, 31.0] {
            let kernel = aperture.kernel(t);
            let sum: f64 = kernel.weights().map(|w| f64::from(w.2)).sum();
            assert!((sum - 1.0).abs() < 1e-5, "{aperture:?} {t}: {sum}");
            if t.abs() <= 0.5 {
                // The chords of a curve extend past the pixel by some ten-thousandths.
                let own = kernel.weights().find(|w| (w.0, w.1) == (0, 0)).map_or(0.0, |w| w.2);
                assert!(own > 1.0 - 1e-5, "{aperture:?} {t}: {own}");
            }
        }
    }
}

#[test]
fn whole_pixels_have_the_weight_of_their_share_of_the_area() {
    for (aperture, _) in openings() {
        if !aperture.is_clear() && aperture.features() != [Feature::Obstruction] || aperture.lean != [0.0; 2]
        {
            continue;
        }
        for t in [3.2, -17.0] {
            let whole = f64::from(aperture.kernel(t).run_weight);
            let exact = 1.0 / (PI * t * t * aperture.relative_area());
            assert!((whole / exact - 1.0).abs() < 1e-4, "{aperture:?} {t}: {whole} against {exact}");
        }
    }
}

#[test]
fn a_kernel_in_front_is_the_one_behind_turned_round() {
    for aperture in [
        Aperture::new(3, 20.0, None).unwrap(),
        Aperture::new(3, 20.0, None).unwrap().with_ratio(1.4).unwrap(),
    ] {
        let sorted = |t: f64, sign: i32| {
            let mut w: Vec<_> =
                aperture.kernel(t).weights().map(|(x, y, w)| (sign * x, sign * y, w)).collect();
            w.sort_by_key(|w| (w.1, w.0));
            w
        };
        for (a, b) in sorted(6.2, 1).iter().zip(sorted(-6.2, -1)) {
            assert!((a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() < 1e-8);
        }
    }
}

#[test]
fn bad_values_are_named() {
    for (aperture, name) in [
        (Aperture::new(2, 0.0, None), "blades"),
        (Aperture::DISC.with_ratio(0.0), "ratio"),
        (Aperture::DISC.with_obstruction(1.0), "obstruction"),
        (Aperture::DISC.with_spherical(f64::NAN), "spherical"),
        (Aperture::DISC.with_roundness(0.5), "roundness"),
    ] {
        assert!(aperture.unwrap_err().to_string().starts_with(name));
    }
}

proptest! {
    #[test]
    fn kernels_of_any_opening_and_radius_keep_all_light(
        opening in 0..openings().len(),
        t in -60.0..60.0f64,
    ) {
        let aperture = &openings()[opening].0;
        for kernel in [aperture.kernel(t), aperture.transfer_kernel(t)] {
            let mut sum = 0.0;
            for (dx, dy, w) in kernel.weights() {
                prop_assert!(w >= 0.0 && dx.abs() <= kernel.reach && dy.abs() <= kernel.reach);
                sum += f64::from(w);
            }
            prop_assert!((sum - 1.0).abs() < 1e-5, "{aperture:?}: {sum}");
        }
    }
}
