//! Any small picture through any lens by any method: depth is read, a plan made, and its kernels run.
#![no_main]

use _dofsim::aperture::{self, Aperture};
use _dofsim::cancel::Cancel;
use _dofsim::depth::{DepthKind, Invalid, disparity_plane};
use _dofsim::device::Device;
use _dofsim::error::Error;
use _dofsim::method::Method;
use _dofsim::optics::{Aberrations, BarnDoors, FovAxis, Frame, Lens, Mount, Strength, Vignetting};
use _dofsim::picture::{Layer, Picture, Size};
use _dofsim::plan::{gaussian, hexagonal, lens, levels, poisson, sprites, taps};
use _dofsim::renderer::Renderer;
use _dofsim::simd::Simd;
use arbitrary::{Result, Unstructured};
use libfuzzer_sys::{Corpus, fuzz_target};
use std::sync::Arc;

fuzz_target!(|bytes: &[u8]| -> Corpus {
    match run(&mut Unstructured::new(bytes)) {
        Ok(()) => Corpus::Keep,
        Err(_) => Corpus::Reject,
    }
});

/// Discs of the flagship are exact on even surfaces: very large ones take seconds, and show nothing that others do not.
const WIDEST_PX: f64 = 150.0;

/// What is refused is not worth keeping.
enum Refused {
    Bytes,
    Arguments,
}

impl From<arbitrary::Error> for Refused {
    fn from(_: arbitrary::Error) -> Refused {
        Refused::Bytes
    }
}

impl From<Error> for Refused {
    fn from(_: Error) -> Refused {
        Refused::Arguments
    }
}

fn run(u: &mut Unstructured) -> std::result::Result<(), Refused> {
    let lens = lens(u)?;
    let aperture = aperture(u)?;
    let method = method(u, &aperture)?;
    let supersample = u.int_in_range(1..=2)?;
    let (width, height): (usize, usize) = (u.int_in_range(1..=80)?, u.int_in_range(1..=40)?);
    let layers = if matches!(method, Method::Lens(_)) { u.int_in_range(1..=3)? } else { 1 };
    let channels = if layers > 1 { 4 } else { u.int_in_range(1..=4)? };
    let coverage = layers > 1 || channels % 2 == 0 && u.arbitrary()?;
    let lights = channels - usize::from(coverage);

    let frame = Frame { width, height, finer: supersample, margin: 0 };
    let size = Size { width: width * supersample, height: height * supersample, channels };
    let imaging = frame.imaging(&lens)?;
    method.check(&lens, layers, lights)?;
    let kind = depth_kind(u)?;
    let invalid = if u.arbitrary()? { Invalid::Raise } else { Invalid::Far };
    let mut planes = Vec::new();
    for _ in 0..layers {
        let (colors, depths) = (pattern(u)?, pattern(u)?);
        let pixels = size.pixels();
        let mut color = Vec::with_capacity(channels * pixels);
        for c in 0..channels {
            let is_coverage = coverage && c == channels - 1;
            let value = |code: u8| if is_coverage { f32::from(code) / 255.0 } else { brightness(code) };
            color.extend((0..pixels).map(|i| value(colors[(i + c * c) % colors.len()])));
        }
        let depth: Vec<f32> = (0..pixels).map(|i| distance(depths[i % depths.len()])).collect();
        let disparity = disparity_plane(&depth, size.width, kind, frame.rays(&lens), invalid)?;
        planes.push(Layer::new(Arc::new(color.as_slice().into()), disparity));
    }
    let radii = planes.iter().map(|layer: &Layer| imaging.optics.largest_radius_px(layer.disparity_range()));
    if radii.fold(0.0, f64::max) > WIDEST_PX && matches!(method, Method::Lens(_)) {
        return Err(Refused::Arguments);
    }
    let dark = planes.iter().flat_map(|layer| layer.color.iter()).fold(0.0, |least: f32, v| least.min(*v));

    let renderer = Renderer::new(Picture::new(size, planes), lights, None, supersample);
    let cancel = Cancel::default();
    let render = |simd: Simd| {
        let mut out = vec![f32::NAN; width * height * channels];
        renderer.render_each(&[imaging], &method, Device::Cpu, simd, &cancel, vec![&mut out]).map(|_| out)
    };
    let available = Simd::available();
    let out = render(available[available.len() - 1])?;
    assert!(out.iter().all(|v| v.is_finite()), "a value that is no number");
    assert!(dark < 0.0 || out.iter().all(|v| *v >= 0.0), "negative light");
    if u.arbitrary()? {
        let bits = |out: &[f32]| out.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&out), bits(&render(Simd::PORTABLE)?), "instruction sets differ");
    }
    Ok(())
}

/// Some bytes that are repeated over a plane; sizes that are no multiple of their number make edges of all kinds.
fn pattern(u: &mut Unstructured) -> Result<Vec<u8>> {
    let n = u.int_in_range(1..=97)?;
    Ok(u.bytes(n.min(u.len()).max(1))?.to_vec())
}

/// What light may be by the time it is rendered: of any sign, up to 2^33, and as faint as floats go.
fn brightness(code: u8) -> f32 {
    const SCALES: [f32; 8] = [1.0, 1.0, 0.0, -1.0, 300.0, 8e9, 1e-41, 1e-20];
    SCALES[usize::from(code >> 5)] * (1.0 + f32::from(code & 31) / 32.0)
}

/// What a depth map may hold.
fn distance(code: u8) -> f32 {
    const SCALES: [f32; 16] = [
        1.0,
        2.0,
        3.0,
        4.0,
        0.25,
        10.0,
        0.01,
        1e-6,
        1e12,
        3e38,
        1e-41,
        f32::INFINITY,
        0.0,
        -1.0,
        f32::NAN,
        0.5,
    ];
    SCALES[usize::from(code >> 4)] * (1.0 + f32::from(code & 15) / 16.0)
}

fn depth_kind(u: &mut Unstructured) -> Result<DepthKind> {
    Ok(match u.int_in_range(0..=9)? {
        0 => DepthKind::Distance,
        1 => DepthKind::InverseZ,
        2 => DepthKind::Disparity,
        3 => DepthKind::Relative,
        4 => {
            let planes = (0.1, if u.arbitrary()? { 100.0 } else { f64::INFINITY });
            let (near, far) = if u.ratio(1, 4)? { (planes.1, planes.0) } else { planes };
            DepthKind::ZBuffer { near, far, first: if u.ratio(1, 4)? { -1.0 } else { 0.0 } }
        }
        5 => DepthKind::DistanceFromNear { near: 0.1 },
        _ => DepthKind::Z,
    })
}

/// A number as a user gives it: mostly of ordinary size, and sometimes any at all.
fn number(u: &mut Unstructured, ordinary: std::ops::RangeInclusive<f64>) -> Result<f64> {
    if u.ratio(1, 16)? {
        return u.arbitrary();
    }
    let share = f64::from(u.arbitrary::<u16>()?) / f64::from(u16::MAX);
    Ok(ordinary.start() + share * (ordinary.end() - ordinary.start()))
}

fn three(u: &mut Unstructured, bound: f64) -> Result<[f64; 3]> {
    Ok([number(u, -bound..=bound)?, number(u, -bound..=bound)?, number(u, -bound..=bound)?])
}

fn lens(u: &mut Unstructured) -> std::result::Result<Lens, Refused> {
    let base = if u.ratio(1, 4)? {
        let strength = number(u, 0.0..=30.0)?;
        let strength = if u.arbitrary()? { Strength::Px(strength) } else { Strength::Percent(strength) };
        Lens::from_disparity(strength, number(u, -1.0..=3.0)?)?
    } else {
        let axes = FovAxis::NAMES.map(|(_, axis)| axis);
        Lens::thin(number(u, 0.0..=0.5)?, number(u, 0.1..=12.0)?, number(u, 5.0..=120.0)?, *u.choose(&axes)?)?
    };
    let (mut mount, mut aberrations) = (Mount::PLAIN, Aberrations::NONE);
    for _ in 0..u.int_in_range(0..=2)? {
        match u.int_in_range(0..=9)? {
            0 => mount.tilt_deg = [number(u, -60.0..=60.0)?, number(u, -60.0..=60.0)?],
            1 => mount.principal_point = [number(u, -1.0..=1.0)?, number(u, -1.0..=1.0)?],
            2 => aberrations.field_curvature = number(u, -2.0..=2.0)?,
            3 => aberrations.axial_color = three(u, 0.1)?,
            4 => aberrations.lateral_color = three(u, 0.1)?,
            5 => aberrations.cat_eye = number(u, 0.0..=1.0)?,
            6 => aberrations.coma = number(u, -0.25..=0.25)?,
            7 => aberrations.astigmatism = number(u, -0.25..=0.25)?,
            8 => {
                let half = [number(u, 0.05..=2.0)?, number(u, 0.05..=2.0)?];
                aberrations.barn_doors = Some(BarnDoors { half, moves: number(u, 0.0..=1.0)? });
            }
            _ => aberrations.vignetting = *u.choose(&Vignetting::NAMES.map(|(_, kind)| kind))?,
        }
    }
    Ok(base.mounted(mount)?.with_aberrations(aberrations)?)
}

fn aperture(u: &mut Unstructured) -> std::result::Result<Aperture, Refused> {
    if u.ratio(1, 8)? {
        let columns = u.int_in_range(1..=9)?;
        let values: Vec<f64> = pattern(u)?.into_iter().map(f64::from).collect();
        return Ok(Aperture::of_picture(aperture::Picture::new(
            columns,
            &values[..values.len() / columns * columns],
        )?));
    }
    let blades = *u.choose(&[0, 0, 3, 4, 5, 6, 9, 64])?;
    let apodization = if u.ratio(1, 4)? { Some(number(u, 0.05..=2.0)?) } else { None };
    let mut aperture = Aperture::new(blades, number(u, -180.0..=180.0)?, apodization)?;
    for _ in 0..u.int_in_range(0..=2)? {
        aperture = match u.int_in_range(0..=3)? {
            0 => aperture.with_roundness(number(u, 0.0..=1.0)?)?,
            1 => aperture.with_ratio(number(u, 0.05..=20.0)?)?,
            2 => aperture.with_obstruction(number(u, 0.0..=0.95)?)?,
            _ => aperture.with_spherical(number(u, -1.0..=1.0)?)?,
        };
    }
    Ok(aperture)
}

/// A method as the module for Python makes it, of openings that it takes there.
fn method(u: &mut Unstructured, aperture: &Aperture) -> std::result::Result<Method, Refused> {
    use aperture::Feature::{Image, Spherical};
    let chosen = u.int_in_range(0..=8)?;
    let plain = aperture.features().is_empty();
    Ok(match chosen {
        1 if !aperture.features().iter().any(|f| matches!(f, Image | Spherical)) => {
            let pattern = if plain && u.ratio(1, 4)? {
                let mut points = Vec::new();
                for _ in 0..u.int_in_range(1..=40)? {
                    points.push(three(u, 0.7)?);
                }
                poisson::Pattern::of(&points)?
            } else {
                let bokeh = *u.choose(&poisson::Bokeh::NAMES.map(|(_, bokeh)| bokeh))?;
                poisson::Pattern::over(aperture, u.int_in_range(1..=64)?, bokeh)?
            };
            let leak_test = *u.choose(&poisson::LeakTest::NAMES.map(|(_, test)| test))?;
            Method::Poisson(poisson::Settings::new(pattern, number(u, 0.5..=64.0)?, leak_test)?)
        }
        2 if plain => {
            let radius = Some(number(u, 0.5..=64.0)?);
            let range = if u.arbitrary()? { Some(number(u, 0.01..=10.0)?) } else { None };
            let radius = radius.filter(|_| range.is_none());
            Method::Gaussian(gaussian::Settings::new(range, radius)?)
        }
        3 => Method::Hexagonal(hexagonal::Settings::new(Some(aperture), number(u, 1.0..=64.0)?)?),
        4 if plain => {
            let c0_px = if u.arbitrary()? { Some(number(u, 0.5..=64.0)?) } else { None };
            Method::Levels(levels::Settings::new(c0_px)?)
        }
        5 if plain => {
            let factor = if u.arbitrary()? { Some(number(u, 0.0..=2.0)?) } else { None };
            let variant = *u.choose(&taps::Variant::NAMES.map(|(_, variant)| variant))?;
            Method::Taps(taps::Settings::new(variant, factor)?)
        }
        6 | 7 => {
            let shape = if plain && u.arbitrary()? {
                let width = u.int_in_range(1..=9)?;
                let values: Vec<f64> = pattern(u)?.into_iter().map(f64::from).collect();
                let whole = values.len() / width * width;
                sprites::Shape::Texture(sprites::Texture::new(width, values[..whole].to_vec())?)
            } else {
                sprites::Shape::Opening(aperture.clone())
            };
            Method::Sprites(sprites::Settings::new(shape, number(u, 0.5..=4.0)?, number(u, 1.0..=64.0)?)?)
        }
        _ => {
            let views = if u.arbitrary()? { Some(u.int_in_range(16..=96)?) } else { None };
            Method::Lens(lens::Settings::new(aperture.clone(), views))
        }
    })
}
