//! A render from end to end: a picture, what is prepared from it, and what comes out.

use crate::cancel::Cancel;
use crate::cpu;
use crate::cpu::lens::{Settings, Sheets};
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::Picture;
use std::sync::{Arc, Mutex};

/// A picture on its device, with what has been prepared from it.
pub struct Scene {
    picture: Picture,
    /// Pixels of the picture to one of the output, along each axis.
    supersample: usize,
    /// The sheets last used, with the lens strength they were made for.
    sheets: Mutex<Option<(f64, Arc<Sheets>)>>,
}

impl Scene {
    /// A scene of a picture whose width and height are multiples of `supersample`.
    pub fn new(picture: Picture, supersample: usize) -> Scene {
        Scene { picture, supersample, sheets: Mutex::new(None) }
    }

    /// The sheets for this lens, made anew if those at hand are for another strength.
    ///
    /// The lock is never held over parallel work: a worker that waits inside it may be handed another render of
    /// the same scene, and would wait for itself.
    fn sheets(&self, optics: &Optics, settings: &Settings, cancel: &Cancel) -> Result<Arc<Sheets>> {
        // A poisoned lock only means that another render was interrupted; what it holds is whole or absent.
        let cached = || self.sheets.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let at_hand = cached().as_ref().filter(|(k, _)| *k == optics.k).map(|(_, sheets)| Arc::clone(sheets));
        if let Some(sheets) = at_hand {
            cpu::lens::check_radius(&self.picture, optics)?;
            return Ok(sheets);
        }
        let sheets = Arc::new(cpu::lens::prepare(&self.picture, optics, settings.simd, cancel)?);
        *cached() = Some((optics.k, Arc::clone(&sheets)));
        Ok(sheets)
    }

    /// The scene through a lens, interleaved, premultiplied where it has coverage.
    pub fn render(&self, optics: &Optics, settings: &Settings, cancel: &Cancel) -> Result<Vec<f32>> {
        let sheets = self.sheets(optics, settings, cancel)?;
        let full = cpu::lens::render(&self.picture, &sheets, optics, settings, self.supersample, cancel)?;
        Ok(match self.supersample {
            1 => full,
            n => cpu::resolve::box_average(&full, self.picture.size, n),
        })
    }
}
