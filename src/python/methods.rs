//! The methods by name, and their options.

use super::aperture::PyAperture;
use super::argument::{Argument, argument};
use super::errors::{choice, shown};
use crate::aperture::{Aperture, Feature};
use crate::error::{Result, value_error};
use crate::method::Method;
use crate::optics::MaxRadius;
use crate::plan::lens;
use crate::plan::{gaussian, hexagonal, levels, poisson, sprites, taps};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Reads the options of one method.
type Read = fn(&mut Options<'_, '_>) -> PyResult<Method>;

/// A method by name: the function that reads its options, and the deviations from a clear disc that it can render.
type Entry = (&'static str, (Read, &'static [Feature]));

/// All methods. [`Method::check`] determines which properties of the lens a method supports.
const METHODS: [Entry; 7] = {
    use Feature::{Apodization, Blades, Image, Obstruction, Ratio, Roundness, Spherical};
    const ANY: &[Feature] = &[Blades, Roundness, Ratio, Obstruction, Apodization, Spherical, Image];
    [
        ("lens", (read_lens, ANY)),
        ("poisson", (read_poisson, &[Blades, Roundness, Ratio, Obstruction, Apodization])),
        ("gaussian", (read_gaussian, &[])),
        ("hexagonal", (read_hexagonal, &[Blades])),
        ("levels", (read_levels, &[])),
        ("taps", (read_taps, &[])),
        ("sprites", (read_sprites, ANY)),
    ]
};

/// Names of the methods that `render` takes.
#[pyfunction]
pub fn methods_available() -> Vec<&'static str> {
    METHODS.iter().map(|(name, _)| *name).collect()
}

/// The method of this name with these options; an option that it does not have is an error. Returns also the bound on
/// radii, unless it is a setting of the method, which then keeps it.
pub fn read_method(
    name: &str,
    aperture: Option<&PyAperture>,
    max_coc_px: Option<f64>,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<(Method, Option<MaxRadius>)> {
    let (read, features) = choice("method", name, &METHODS)?;
    refuse_features(name, aperture, features)?;
    let max_radius = max_coc_px.map(MaxRadius::new).transpose()?;
    let mut options = Options { method: name, aperture, max_radius, given, known: Vec::new() };
    let method = read(&mut options)?;
    options.refuse_others()?;
    Ok((method, options.max_radius))
}

/// Refuses apertures that the method cannot render.
fn refuse_features(method: &str, aperture: Option<&PyAperture>, accepted: &[Feature]) -> Result<()> {
    let Some(aperture) = aperture else { return Ok(()) };
    let names = |features: &mut dyn Iterator<Item = Feature>| {
        let name = |feature: Feature| Feature::NAMES.iter().find(|n| n.1 == feature).map(|n| n.0);
        features.filter_map(name).collect::<Vec<_>>().join(", ")
    };
    let alien = names(&mut aperture.core.features().into_iter().filter(|f| !accepted.contains(f)));
    if alien.is_empty() {
        return Ok(());
    }
    let can = match accepted {
        [] => "a plain disc".to_owned(),
        _ => format!("a disc with no more than {}", names(&mut accepted.iter().copied())),
    };
    Err(value_error!(
        "aperture must be {can} for method={method:?}, which cannot draw {alien}; got {aperture}"
    ))
}

fn read_lens(options: &mut Options) -> PyResult<Method> {
    let views = options.value("views")?;
    if let Some(n) = views
        && !(16..=16_384).contains(&n)
    {
        return Err(value_error!("views must be from 16 to 16384; got {n}").into());
    }
    let resolution = options.word("resolution", &lens::Resolution::NAMES)?;
    let resolution = resolution.unwrap_or(lens::Resolution::Adaptive);
    Ok(Method::Lens(lens::Settings::new(options.aperture(), views, resolution)))
}

fn read_poisson(options: &mut Options) -> PyResult<Method> {
    let bokeh = options.word("bokeh", &poisson::Bokeh::NAMES)?;
    let pattern = match options.get("taps")? {
        Some(taps) if is_no_integer(&taps) => {
            if bokeh.is_some() || options.aperture() != Aperture::DISC {
                return Err(value_error!(
                    "taps in an array have their own shape and weights: bokeh and aperture must not be given"
                )
                .into());
            }
            poisson::Pattern::of(&read_points("taps", &taps)?)?
        }
        count => {
            let count = count.map_or(Ok(poisson::TWELVE.len()), |count| argument("taps", &count))?;
            poisson::Pattern::over(&options.aperture(), count, bokeh.unwrap_or(poisson::Bokeh::Uniform))?
        }
    };
    let max_coc_px = options.take_max_coc_px().unwrap_or(poisson::Settings::MAX_COC_PX);
    let leak_test = options.word("leak_test", &poisson::LeakTest::NAMES)?.unwrap_or(poisson::LeakTest::On);
    Ok(Method::Poisson(poisson::Settings::new(pattern, max_coc_px, leak_test)?))
}

fn is_no_integer(value: &Bound<'_, PyAny>) -> bool {
    value.extract::<i64>().is_err_and(|error| error.is_instance_of::<PyTypeError>(value.py()))
}

/// An array of shape (N, 2) or (N, 3), or nested sequences of this form. A missing third column is 1.
fn read_points(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 3]>> {
    let rows: Option<Vec<Vec<f64>>> = given.call_method0("tolist").as_ref().unwrap_or(given).extract().ok();
    let points = rows.and_then(|rows| {
        rows.iter()
            .map(|row| match *row.as_slice() {
                [x, y] => Some([x, y, 1.0]),
                [x, y, weight] => Some([x, y, weight]),
                _ => None,
            })
            .collect::<Option<Vec<_>>>()
    });
    points.ok_or_else(|| {
        PyTypeError::new_err(format!(
            "{name} must be a whole number or an array of shape (N, 2) or (N, 3): x, y and weight; got {}",
            shown(given)
        ))
    })
}

fn read_gaussian(options: &mut Options) -> PyResult<Method> {
    let focal_range = options.value("focal_range")?;
    Ok(Method::Gaussian(gaussian::Settings::new(focal_range, options.take_max_coc_px())?))
}

fn read_taps(options: &mut Options) -> PyResult<Method> {
    let variant = options.word("variant", &taps::Variant::NAMES)?.unwrap_or(taps::Variant::Thirteen);
    let hyperfocal_factor = options.value("hyperfocal_factor")?;
    Ok(Method::Taps(taps::Settings::new(variant, hyperfocal_factor)?))
}

fn read_hexagonal(options: &mut Options) -> PyResult<Method> {
    let max_coc_px = options.take_max_coc_px().unwrap_or(hexagonal::Settings::MAX_COC_PX);
    let aperture = options.aperture.map(|a| &a.core);
    Ok(Method::Hexagonal(hexagonal::Settings::new(aperture, max_coc_px)?))
}

fn read_levels(options: &mut Options) -> PyResult<Method> {
    Ok(Method::Levels(levels::Settings::new(options.value("c0_px")?)?))
}

fn read_sprites(options: &mut Options) -> PyResult<Method> {
    let shape = match options.plane("sprite")? {
        None => sprites::Shape::Opening(options.aperture()),
        Some(_) if options.aperture.is_some() => {
            return Err(
                value_error!("aperture and sprite are both given; a point is drawn as one of them").into()
            );
        }
        Some((width, values)) => sprites::Shape::Texture(sprites::Texture::new(width, values)?),
    };
    let threshold_px = options.value("coc_threshold_px")?.unwrap_or(sprites::Settings::THRESHOLD_PX);
    let max_coc_px = options.take_max_coc_px().unwrap_or(sprites::Settings::MAX_COC_PX);
    Ok(Method::Sprites(sprites::Settings::new(shape, threshold_px, max_coc_px)?))
}

/// The options that a caller gave. Reading an option marks it as known. None stands for an option that was not given.
struct Options<'a, 'py> {
    method: &'a str,
    aperture: Option<&'a PyAperture>,
    /// The bound on radii, until the method takes it for a setting.
    max_radius: Option<MaxRadius>,
    given: Option<&'a Bound<'py, PyDict>>,
    known: Vec<&'static str>,
}

impl<'py> Options<'_, 'py> {
    fn get(&mut self, name: &'static str) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.known.push(name);
        let value = self.given.map_or(Ok(None), |given| given.get_item(name))?;
        Ok(value.filter(|value| !value.is_none()))
    }

    /// An option of one type.
    fn value<T: Argument>(&mut self, name: &'static str) -> PyResult<Option<T>> {
        self.get(name)?.map(|value| argument(name, &value)).transpose()
    }

    /// An option with one of the accepted names.
    fn word<T: Copy>(&mut self, name: &'static str, accepted: &[(&str, T)]) -> PyResult<Option<T>> {
        let word: Option<String> = self.value(name)?;
        word.map(|word| choice(name, &word, accepted)).transpose()
    }

    /// An option that is a two-dimensional array of numbers: its number of columns, and its values row by row.
    fn plane(&mut self, name: &'static str) -> PyResult<Option<(usize, Vec<f64>)>> {
        let Some(value) = self.get(name)? else { return Ok(None) };
        let refused = |_| {
            let shown = shown(&value);
            PyTypeError::new_err(format!("{name} must be a two-dimensional array of numbers; got {shown}"))
        };
        let numpy = value.py().import("numpy")?;
        let array = numpy.call_method1("asarray", (&value, "float64")).map_err(refused)?;
        let array = super::samples::array(name, &array)?;
        let array: PyReadonlyArray2<f64> = array.extract().map_err(|e: PyErr| refused(e))?;
        let array = array.as_array();
        Ok(Some((array.ncols(), array.iter().copied().collect())))
    }

    /// The bound on radii in pixels, which is from then on the method's to keep.
    fn take_max_coc_px(&mut self) -> Option<f64> {
        self.max_radius.take().map(MaxRadius::px)
    }

    /// The shape of the aperture.
    fn aperture(&self) -> Aperture {
        self.aperture.map_or(Aperture::DISC, |a| a.core.clone())
    }

    /// Refuses options that the method does not have.
    fn refuse_others(&self) -> PyResult<()> {
        for name in self.given.iter().flat_map(|given| given.keys()) {
            let name: String = name.extract()?;
            if !self.known.contains(&name.as_str()) {
                let has = match self.known.as_slice() {
                    [] => "none of its own".to_owned(),
                    known => known.join(", "),
                };
                return Err(PyTypeError::new_err(format!(
                    "{name} is not an option of method={:?}, which has {has}",
                    self.method
                )));
            }
        }
        Ok(())
    }
}
