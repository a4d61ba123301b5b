//! Shaders whose divisions are rounded otherwise, for tests: Vulkan lets a quotient be 2.5 units in the last place off,
//! and no result may hang on such a unit.

use naga::front::wgsl;
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Whether this is a shader whose types fit.
fn is_valid(source: &str) -> bool {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
    wgsl::parse_str(source).is_ok_and(|module| validator.validate(&module).is_ok())
}

/// The source with the dividend of each division of floats multiplied by `factor`.
pub fn perturbed(source: &str, factor: f32) -> String {
    const DIVIDED: &str = " / ";
    let perturbing = format!(" * {factor:?} / ");
    let (mut before, mut rest) = (String::new(), source);
    while let Some((own, behind)) = rest.split_once(DIVIDED) {
        before += own;
        rest = behind;
        let is_comment = before.lines().last().is_some_and(|line| line.trim_start().starts_with("//"));
        // A division of integers does not take the factor: there is no such product.
        let is_of_floats = || is_valid(&[&before, &perturbing, rest].concat());
        before += if !is_comment && is_of_floats() { &perturbing } else { DIVIDED };
    }
    before + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divisions_of_floats_are_perturbed_and_others_are_not() {
        let source = "
            // One / two.
            fn shares(a: f32, b: vec2<f32>, i: u32) -> f32 {
                return a / 2.0 + (b / a).x + f32(i / 2u) / 3.0;
            }";
        let expected = "
            // One / two.
            fn shares(a: f32, b: vec2<f32>, i: u32) -> f32 {
                return a * 1.5 / 2.0 + (b * 1.5 / a).x + f32(i / 2u) * 1.5 / 3.0;
            }";
        assert_eq!(perturbed(source, 1.5), expected);
    }
}
