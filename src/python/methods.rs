//! The methods by name, and the options that each of them takes.

use super::aperture::PyAperture;
use super::errors::choice;
use crate::aperture::Aperture;
use crate::cpu::lens;
use crate::error::{Result, value_error};
use crate::plan::taps;
use crate::render::Method;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Reads the options of one method.
type Read = fn(&mut Options<'_, '_>) -> PyResult<Method>;

/// The methods there are.
const METHODS: [(&str, Read); 2] = [("lens", read_lens), ("taps", read_taps)];

/// The method of this name with these options, none of which may be left over.
pub fn read_method(
    name: &str,
    aperture: Option<&PyAperture>,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<Method> {
    let read = choice("method", name, &METHODS)?;
    let mut options = Options { method: name, aperture, given, known: Vec::new() };
    let method = read(&mut options)?;
    options.refuse_others()?;
    Ok(method)
}

fn read_lens(options: &mut Options) -> PyResult<Method> {
    let views = options.value("views", "a whole number")?;
    if let Some(n) = views
        && !(16..=16_384).contains(&n)
    {
        return Err(value_error!("views must be from 16 to 16384; got {n}").into());
    }
    Ok(Method::Lens(lens::Settings { aperture: options.aperture(), views }))
}

fn read_taps(options: &mut Options) -> PyResult<Method> {
    options.only_a_disc()?;
    let variant = options.word("variant", &taps::Variant::NAMES)?.unwrap_or(taps::Variant::Thirteen);
    let hyperfocal_factor = options.value("hyperfocal_factor", "a number")?;
    Ok(Method::Taps(taps::Settings::new(variant, hyperfocal_factor)?))
}

/// The options that a caller gave; what reads one also makes it known. None stands for an option not given.
struct Options<'a, 'py> {
    method: &'a str,
    aperture: Option<&'a PyAperture>,
    given: Option<&'a Bound<'py, PyDict>>,
    known: Vec<&'static str>,
}

impl<'py> Options<'_, 'py> {
    fn get(&mut self, name: &'static str) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.known.push(name);
        let value = self.given.map_or(Ok(None), |given| given.get_item(name))?;
        Ok(value.filter(|value| !value.is_none()))
    }

    /// A value of one type; `what` says which.
    fn value<T: for<'a> FromPyObject<'a, 'py>>(
        &mut self,
        name: &'static str,
        what: &str,
    ) -> PyResult<Option<T>> {
        let Some(value) = self.get(name)? else { return Ok(None) };
        let read = value.extract().map_err(|_| {
            let shown = value.repr().map_or_else(|_| value.get_type().to_string(), |r| r.to_string());
            PyTypeError::new_err(format!("{name} must be {what}; got {shown}"))
        });
        read.map(Some)
    }

    /// One of the words accepted.
    fn word<T: Copy>(&mut self, name: &'static str, accepted: &[(&str, T)]) -> PyResult<Option<T>> {
        let word: Option<String> = self.value(name, "a word")?;
        word.map(|word| choice(name, &word, accepted)).transpose()
    }

    /// The shape of the opening.
    fn aperture(&self) -> Aperture {
        self.aperture.map_or(Aperture::DISC, |a| a.core)
    }

    /// Refuses any other opening than a disc.
    fn only_a_disc(&self) -> Result<()> {
        match self.aperture {
            Some(a) if a.core != Aperture::DISC => Err(value_error!(
                "aperture must be a plain disc for method={:?}, which cannot draw another shape; got {a}",
                self.method
            )),
            _ => Ok(()),
        }
    }

    /// Refuses what is not an option of the method.
    fn refuse_others(&self) -> PyResult<()> {
        for name in self.given.iter().flat_map(|given| given.keys()) {
            let name: String = name.extract()?;
            if !self.known.contains(&name.as_str()) {
                return Err(PyTypeError::new_err(format!(
                    "{name} is not an option of method={:?}, which has {}",
                    self.method,
                    self.known.join(", ")
                )));
            }
        }
        Ok(())
    }
}
