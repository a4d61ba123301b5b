//! What a render does under one lens, worked out from depths alone.

use super::Settings;
use super::blocks::Blocks;
use super::footprint::Footprint;
use super::pack::Padding;
use super::sheets::Sheets;
use super::sweep::Missed;
use super::tiles::{self, Tile, Work};
use crate::aperture::Aperture;
use crate::optics::Optics;
use crate::views::{self, View};
use std::collections::{BTreeMap, BTreeSet};

/// The plan of one render.
pub struct Plan {
    /// Shift of the focus relative to infinity.
    pub s_focus: f64,
    /// The largest shift, in front of the focus plane or behind.
    pub reach_px: f64,
    /// The frame with the margin that rays need.
    pub padding: Padding,
    /// The blocks of the padded frame.
    pub blocks: Blocks,
    /// What each tile needs.
    pub tiles: Vec<Tile>,
    /// The views of every count that some tile needs.
    pub view_sets: BTreeMap<usize, Vec<View>>,
    /// The size at which cells are drawn.
    pub footprint: Footprint,
    /// What rays that meet nothing stand for.
    pub missed: Missed,
}

impl Plan {
    /// The plan for one lens; as [`super::render`] takes it.
    pub fn new(sheets: &Sheets, optics: &Optics, settings: &Settings, supersample: usize) -> Plan {
        let s_focus = optics.k * optics.d_focus;
        let count_views = |radius_px: f64| {
            settings.views.unwrap_or_else(|| views::count_for(radius_px / supersample as f64))
        };
        let area = settings.aperture.relative_area();
        let reach_px = (sheets.shifts.0 - s_focus).abs().max((sheets.shifts.1 - s_focus).abs());
        let padding = Padding::new(sheets.size.width, sheets.size.height, reach_px);
        let blocks = sheets.blocks.padded(&padding);
        let frame = tiles::Frame {
            padding: &padding,
            codes: &sheets.codes,
            blocks: &blocks,
            s_focus,
            barrel: settings.barrel.as_ref(),
        };
        let tiles = tiles::plan(&frame, count_views);
        let view_sets = view_sets(&tiles, &settings.aperture);
        let footprint = Footprint::new(reach_px, |t| views::spacing_px(t, area, count_views(t)));
        let missed = if sheets.opaque { Missed::Unknown } else { Missed::Nothing };
        Plan { s_focus, reach_px, padding, blocks, tiles, view_sets, footprint, missed }
    }
}

fn view_sets(tiles: &[Tile], aperture: &Aperture) -> BTreeMap<usize, Vec<View>> {
    let counts: BTreeSet<usize> = tiles
        .iter()
        .filter_map(|tile| match tile.work {
            Work::Sweep { views, .. } => Some(views),
            Work::Copy | Work::Disc => None,
        })
        .collect();
    counts.into_iter().map(|n| (n, views::views(aperture, n))).collect()
}
