//! The distribution of light from the centre of the opening to its rim: obstruction, apodization, spherical
//! aberration.

/// The side of the focus plane on which a surface is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Nearer than the focus.
    InFront,
    /// Farther than the focus.
    Behind,
}

impl Side {
    /// The side of shift `t`.
    pub fn of(t: f64) -> Side {
        if t > 0.0 { Side::InFront } else { Side::Behind }
    }
}

/// The distribution of light by `rho`, the fraction of the distance from the centre to the rim.
///
/// The density over the opening is `exp(-rho^2 / 2 sigma^2) (1 + s (2 rho^2 - 1))` from the rim of the hole to the
/// rim of the opening. The first factor is apodization of standard deviation `sigma`. The second is spherical
/// aberration, which moves light towards the rim (`s > 0`) behind the focus and just as much towards the centre in
/// front of it. It is linear in `rho^2`, which is what the third-order aberration is to first order. It moves light
/// but adds none: its mean over the disc is 1 for any `s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    /// Fraction of the distance to the rim that is obstructed.
    pub hole: f64,
    /// Standard deviation of the Gaussian transmission.
    pub apodization: Option<f64>,
    /// Strength of the spherical aberration, -1 to 1.
    pub spherical: f64,
}

impl Profile {
    /// All light passes everywhere.
    pub const FLAT: Profile = Profile { hole: 0.0, apodization: None, spherical: 0.0 };

    /// Whether the density is the same wherever the opening is open.
    pub fn is_flat(&self) -> bool {
        self.apodization.is_none() && self.spherical == 0.0
    }

    fn slope(&self, side: Side) -> f64 {
        match side {
            Side::Behind => self.spherical,
            Side::InFront => -self.spherical,
        }
    }

    /// The part of the light that the opening lets through at `rho`; aberration moves light, but does not block any.
    pub fn transmission(&self, rho: f64) -> f64 {
        if rho < self.hole {
            return 0.0;
        }
        self.apodization.map_or(1.0, |sigma| (-0.5 * (rho / sigma).powi(2)).exp())
    }

    /// Light between the rim of the hole and `rho`, up to a constant factor: the integral of the density over
    /// `x = rho^2`, in closed form.
    fn mass(&self, rho: f64, side: Side) -> f64 {
        let s = self.slope(side);
        let (x, x0) = (rho * rho, self.hole * self.hole);
        match self.apodization {
            None => (1.0 - s) * (x - x0) + s * (x * x - x0 * x0),
            Some(sigma) => {
                let a = 0.5 / (sigma * sigma);
                let rest = |x: f64| (-a * x).exp() * ((1.0 - s + 2.0 * s * x) / a + 2.0 * s / (a * a));
                rest(x0) - rest(x)
            }
        }
    }

    /// The fraction of the light that passes within `rho`.
    pub fn light_within(&self, rho: f64) -> f64 {
        // Without spherical aberration both sides are alike.
        self.mass(rho, Side::Behind) / self.mass(1.0, Side::Behind)
    }

    /// The `rho` within which the fraction `u` of the light passes.
    pub fn quantile(&self, u: f64, side: Side) -> f64 {
        let (hole, rim) = (self.hole * self.hole, 1.0);
        match (self.apodization, self.spherical == 0.0) {
            (None, true) => (hole + u * (rim - hole)).sqrt(),
            // The transmission exp(-r^2 / 2 sigma^2), truncated at both rims, has this closed-form quantile.
            (Some(sigma), true) => {
                let [hole, rim] = [hole, rim].map(|x| (-0.5 * x / (sigma * sigma)).exp());
                (-2.0 * (hole - u * (hole - rim)).ln()).sqrt() * sigma
            }
            _ => {
                let wanted = u * self.mass(1.0, side);
                let (mut lo, mut hi) = (self.hole, 1.0);
                for _ in 0..52 {
                    let middle = 0.5 * (lo + hi);
                    if self.mass(middle, side) < wanted { lo = middle } else { hi = middle }
                }
                0.5 * (lo + hi)
            }
        }
    }

    /// The profile as a stack of whole openings, `(scale, weight)`. Between any two of `steps` rims, their sum has
    /// the same light as the profile.
    pub fn stack(&self, steps: usize, side: Side) -> Vec<(f64, f64)> {
        let steps = if self.is_flat() { 1 } else { steps };
        let rim = |i: usize| self.hole + (1.0 - self.hole) * i as f64 / steps as f64;
        let level = |i: usize| {
            let (a, b) = (rim(i), rim(i + 1));
            if self.is_flat() { 1.0 } else { (self.mass(b, side) - self.mass(a, side)) / (b * b - a * a) }
        };
        // Each rim raises the density inside it to its own level, relative to the density outside.
        let mut stack = Vec::new();
        let mut beyond = 0.0;
        for i in (0..steps).rev() {
            stack.push((rim(i + 1), level(i) - beyond));
            beyond = level(i);
        }
        if self.hole > 0.0 {
            stack.push((self.hole, -beyond));
        }
        stack
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROFILES: [Profile; 4] = [
        Profile { hole: 0.4, ..Profile::FLAT },
        Profile { hole: 0.2, apodization: Some(0.4), spherical: 0.0 },
        Profile { hole: 0.0, apodization: None, spherical: 0.7 },
        Profile { hole: 0.3, apodization: Some(0.5), spherical: -1.0 },
    ];

    /// The density by its own formula.
    fn density(p: &Profile, rho: f64, side: Side) -> f64 {
        p.transmission(rho) * (1.0 + p.slope(side) * (2.0 * rho * rho - 1.0))
    }

    #[test]
    fn quantiles_invert_the_light_summed_up() {
        let n = 20_000;
        for p in PROFILES {
            for side in [Side::Behind, Side::InFront] {
                let ring = |i: usize| {
                    let rho = (i as f64 + 0.5) / n as f64;
                    if rho < p.hole { 0.0 } else { density(&p, rho, side) * rho }
                };
                let total: f64 = (0..n).map(ring).sum();
                for u in [0.01, 0.3, 0.77, 1.0] {
                    let end = (p.quantile(u, side) * n as f64) as usize;
                    let below: f64 = (0..end).map(ring).sum::<f64>() / total;
                    assert!((below - u).abs() < 5e-4, "{p:?} {side:?}: {below} against {u}");
                }
            }
        }
    }

    #[test]
    fn stacks_have_the_density_of_their_profile() {
        for p in PROFILES {
            let stack = p.stack(200, Side::Behind);
            for rho in [0.1, 0.35, 0.5, 0.9] {
                let level: f64 = stack.iter().filter(|(scale, _)| rho < *scale).map(|s| s.1).sum();
                let exact = if rho < p.hole { 0.0 } else { density(&p, rho, Side::Behind) };
                assert!((level - exact).abs() < 0.02, "{p:?} {rho}: {level} against {exact}");
            }
        }
    }

    #[test]
    fn aberration_moves_light_and_adds_none() {
        let p = Profile { spherical: 0.8, ..Profile::FLAT };
        for side in [Side::Behind, Side::InFront] {
            assert!((p.mass(1.0, side) - Profile::FLAT.mass(1.0, side)).abs() < 1e-12);
        }
        assert!(p.mass(0.5, Side::Behind) < p.mass(0.5, Side::InFront));
    }
}
