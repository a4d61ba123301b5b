//! A lens as a map from its points to the sensor, measured or traced, at some places of the field.
//!
//! Of a lens that is rotationally symmetric, maps are given for fields to the right of the axis and turned with the
//! field; of any lens, for a grid of places. Lens points are the nodes of a square grid over the unit disc. Between nodes
//! and between places the map is linear along each axis, so that a thin lens, whose map is linear, is itself.

use super::fields::{Direction, Fields, Place};
use crate::error::{Result, value_error};
use std::f64::consts::TAU;

/// Farther than this many radii of the thin lens's disc no ray may land.
const FARTHEST: f64 = 4.0;

/// Where the rays through a point of the lens land, relative to the ray through its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landing {
    /// Of a point in focus, in half diagonals of the picture.
    pub focused: [f64; 2],
    /// Of a point in front of the focus and of one behind it, in radii of the thin lens's disc beyond `focused`.
    /// Points in front are turned by 180 degrees, so that of a thin lens both are the lens point itself.
    pub out_of_focus: [[f64; 2]; 2],
}

impl Landing {
    const LENGTH: usize = 6;

    fn of([a, b, c, d, e, f]: [f64; Landing::LENGTH]) -> Landing {
        Landing { focused: [a, b], out_of_focus: [[c, d], [e, f]] }
    }
}

/// How far a lens differs from a thin one at one height of the field.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deviation {
    /// The largest offset of a point in focus, in half diagonals.
    pub focused: f64,
    /// How far lens points are at most from those of a thin lens, in radii.
    pub lens: f64,
    /// How far inside the rim light is lost, in radii.
    pub lost: f64,
}

impl Deviation {
    /// The larger of both, in everything.
    pub fn max(self, other: Deviation) -> Deviation {
        Deviation {
            focused: self.focused.max(other.focused),
            lens: self.lens.max(other.lens),
            lost: self.lost.max(other.lost),
        }
    }
}

/// One node: a lens point at a height of the field.
#[derive(Debug, Clone, Copy)]
struct Node {
    values: [f64; Landing::LENGTH],
    /// 1 if light arrives, 0 if not.
    light: f64,
}

/// The maps of a lens.
#[derive(Debug, Clone)]
pub struct LensMap {
    fields: Fields,
    across: usize,
    /// As they were given, NaN where no light arrives.
    given: Vec<f64>,
    /// By place, row and column.
    nodes: Vec<Node>,
    deviations: Vec<Deviation>,
    widest: f64,
}

impl PartialEq for LensMap {
    fn eq(&self, other: &LensMap) -> bool {
        // A NaN says that no light arrives, and equals another.
        let same = |a: &f64, b: &f64| a == b || a.is_nan() && b.is_nan();
        self.fields == other.fields
            && self.across == other.across
            && self.given.iter().zip(&other.given).all(|(a, b)| same(a, b))
    }
}

/// The lens point of a node.
fn place(across: usize, column: usize, row: usize) -> [f64; 2] {
    [column, row].map(|i| 2.0 * i as f64 / (across - 1) as f64 - 1.0)
}

/// The interval of a rising list in which a value lies, and the fraction of it; values beyond the ends are at the ends.
fn interval(of: &[f64], value: f64) -> (usize, f64) {
    if of.len() == 1 {
        return (0, 0.0);
    }
    let last = of.len() - 2;
    let i = of.partition_point(|v| *v <= value).saturating_sub(1).min(last);
    (i, ((value - of[i]) / (of[i + 1] - of[i])).clamp(0.0, 1.0))
}

/// The first and the last of the values in a rising list between which those from `least` to `most` lie.
fn between(of: &[f64], least: f64, most: f64) -> (usize, usize) {
    let (first, (last, beyond)) = (interval(of, least).0, interval(of, most));
    (first, if beyond > 0.0 { last + 1 } else { last })
}

/// The maps of a grid around a place, with their weights.
fn maps_around([x, y]: &[Vec<f64>; 2], at: [f64; 2]) -> impl Iterator<Item = (usize, f64)> + use<> {
    let ends = |of: &[f64], v: f64| {
        let (i, f) = interval(of, v);
        [(i, 1.0 - f), (i + 1, f)]
    };
    let (columns, rows, across) = (ends(x, at[0]), ends(y, at[1]), x.len());
    let maps = rows.into_iter().flat_map(move |(y, of_row)| {
        columns.into_iter().map(move |(x, of_column)| (y * across + x, of_row * of_column))
    });
    maps.filter(|(_, weight)| *weight > 0.0)
}

impl LensMap {
    /// The maps at these places. `given` holds for each place, row and column of `across` x `across` lens points the six
    /// numbers of a [`Landing`]: focused, in front, behind.
    pub fn new(fields: Fields, across: usize, given: Vec<f64>) -> Result<LensMap> {
        fields.check()?;
        let of_place = across * across * Landing::LENGTH;
        let mut nodes = Vec::new();
        for (i, given) in given.chunks(of_place).enumerate() {
            nodes.extend(read(&fields.name(i), across, given)?);
        }
        let mut map = LensMap { fields, across, given, nodes, deviations: Vec::new(), widest: 0.0 };
        map.deviations = (0..map.fields.count()).map(|i| map.deviation_of(i)).collect();
        map.widest = map.widest_disc();
        Ok(map)
    }

    /// The places, the number of lens points along each axis, and the values as they were given.
    pub fn parts(&self) -> (&Fields, usize, &[f64]) {
        (&self.fields, self.across, &self.given)
    }

    /// How many times as large as that of a thin lens the largest disc is; at least 1.
    pub fn widest(&self) -> f64 {
        self.widest
    }

    /// The four nodes around a lens point in map number `i`, with their weights.
    fn around(&self, i: usize, l: [f64; 2]) -> [(usize, f64); 4] {
        let last = self.across - 1;
        let [(x, fx), (y, fy)] = l.map(|v| {
            // Beyond the grid, the map goes on straight.
            let at = 0.5 * (v + 1.0) * last as f64;
            let node = (at.max(0.0) as usize).min(last - 1);
            (node, at - node as f64)
        });
        let at = |x: usize, y: usize| (i * self.across + y) * self.across + x;
        [
            (at(x, y), (1.0 - fx) * (1.0 - fy)),
            (at(x + 1, y), fx * (1.0 - fy)),
            (at(x, y + 1), (1.0 - fx) * fy),
            (at(x + 1, y + 1), fx * fy),
        ]
    }

    /// The landing of lens point `l` in map number `i`.
    fn of_map(&self, i: usize, l: [f64; 2]) -> [f64; Landing::LENGTH] {
        let mut values = [0.0; Landing::LENGTH];
        for (node, weight) in self.around(i, l) {
            values.iter_mut().zip(self.nodes[node].values).for_each(|(v, node)| *v += weight * node);
        }
        values
    }

    /// The part of the light that arrives through lens point `l` in map number `i`.
    fn light_of_map(&self, i: usize, l: [f64; 2]) -> f64 {
        // Nodes outside of the lens know nothing of light: beside the rim, those a cell further inside are asked.
        let inside = 1.0 - 3.0 / (self.across - 1) as f64;
        let within = (inside / l[0].hypot(l[1]).max(1e-9)).min(1.0);
        let around = self.around(i, l.map(|v| v * within));
        around.iter().map(|(node, weight)| weight * self.nodes[*node].light).sum()
    }

    /// The axis of lens points and of offsets at a place: maps at heights are turned with the field.
    pub fn axis(&self, place: Place) -> Direction {
        match self.fields {
            Fields::Heights(_) => place.away,
            Fields::Grid(_) => Direction::RIGHT,
        }
    }

    /// Where rays of a place through lens point `l` land, both along its [axis](LensMap::axis).
    pub fn at(&self, place: Place, l: [f64; 2]) -> Landing {
        match &self.fields {
            Fields::Heights(heights) => {
                let (i, f) = interval(heights, place.height);
                let mut values = self.of_map(i, l);
                if f > 0.0 {
                    let farther = self.of_map(i + 1, l);
                    values.iter_mut().zip(farther).for_each(|(v, farther)| *v += f * (farther - *v));
                }
                Landing::of(values)
            }
            Fields::Grid(grid) => {
                let mut values = [0.0; Landing::LENGTH];
                for (i, weight) in maps_around(grid, place.at()) {
                    values.iter_mut().zip(self.of_map(i, l)).for_each(|(v, of_map)| *v += weight * of_map);
                }
                Landing::of(values)
            }
        }
    }

    /// Whether they arrive.
    pub fn arrives(&self, place: Place, l: [f64; 2]) -> bool {
        let light = match &self.fields {
            Fields::Heights(heights) => {
                let (i, f) = interval(heights, place.height);
                let light = self.light_of_map(i, l);
                let farther = if f > 0.0 { self.light_of_map(i + 1, l) } else { light };
                light + f * (farther - light)
            }
            Fields::Grid(grid) => {
                maps_around(grid, place.at()).map(|(i, weight)| weight * self.light_of_map(i, l)).sum()
            }
        };
        light >= 0.5
    }

    /// How far the lens differs from a thin one at a place, at most.
    pub fn deviation(&self, place: Place) -> Deviation {
        match &self.fields {
            Fields::Heights(heights) => {
                let (i, f) = interval(heights, place.height);
                if f > 0.0 { self.deviations[i].max(self.deviations[i + 1]) } else { self.deviations[i] }
            }
            Fields::Grid(grid) => self.deviation_of_maps(maps_around(grid, place.at()).map(|(i, _)| i)),
        }
    }

    /// The same for all places of a rectangle: those of its corners with the least and the greatest columns and rows, and
    /// those of its nearest and its farthest place from the axis.
    pub fn deviation_between(&self, [first, last]: [Place; 2], [nearest, farthest]: [Place; 2]) -> Deviation {
        match &self.fields {
            Fields::Heights(heights) => {
                let (first, last) = between(heights, nearest.height, farthest.height);
                self.deviation_of_maps(first..=last)
            }
            Fields::Grid(grid) => {
                let ends = [0, 1].map(|axis| between(&grid[axis], first.at()[axis], last.at()[axis]));
                let [columns, rows] = ends.map(|(first, last)| first..=last);
                let across = grid[0].len();
                self.deviation_of_maps(rows.flat_map(|y| columns.clone().map(move |x| y * across + x)))
            }
        }
    }

    fn deviation_of_maps(&self, maps: impl Iterator<Item = usize>) -> Deviation {
        maps.fold(Deviation::default(), |all, i| all.max(self.deviations[i]))
    }

    fn deviation_of(&self, i: usize) -> Deviation {
        let cell = 2.0 / (self.across - 1) as f64;
        let mut all = Deviation::default();
        for (k, node) in
            self.nodes[i * self.across * self.across..][..self.across * self.across].iter().enumerate()
        {
            let l = place(self.across, k % self.across, k / self.across);
            let rho = l[0].hypot(l[1]);
            // A point of the lens lies among nodes that are at most the diagonal of a cell outside of it.
            if rho > 1.0 + std::f64::consts::SQRT_2 * cell {
                continue;
            }
            let Landing { focused, out_of_focus } = Landing::of(node.values);
            let off = |v: [f64; 2]| (v[0] - l[0]).hypot(v[1] - l[1]);
            let lost = if node.light == 0.0 { 1.0 - rho } else { 0.0 };
            all = all.max(Deviation {
                focused: focused[0].hypot(focused[1]),
                lens: off(out_of_focus[0]).max(off(out_of_focus[1])),
                lost,
            });
        }
        all
    }

    /// See [`LensMap::widest`]. Lens points on the rim and between it and the middle are looked at.
    fn widest_disc(&self) -> f64 {
        const DIRECTIONS: usize = 256;
        const RINGS: usize = 16;
        let mut widest = 1.0f64;
        for i in 0..self.fields.count() {
            for (ring, turn) in (1..=RINGS).flat_map(|ring| (0..DIRECTIONS).map(move |turn| (ring, turn))) {
                let (sin, cos) = (TAU * turn as f64 / DIRECTIONS as f64).sin_cos();
                let rho = ring as f64 / RINGS as f64;
                let values = self.of_map(i, [rho * cos, rho * sin]);
                let [a, b] = Landing::of(values).out_of_focus.map(|v| v[0].hypot(v[1]));
                widest = widest.max(a).max(b);
            }
        }
        // Sines and cosines are rounded.
        if widest < 1.0 + 1e-12 { 1.0 } else { widest }
    }
}

/// The nodes of the map of one place. Where no light arrives, and outside the lens if nothing is given there, the map goes on as
/// beside it.
fn read(field: &str, across: usize, given: &[f64]) -> Result<Vec<Node>> {
    let given_at =
        |i: usize| -> [f64; Landing::LENGTH] { std::array::from_fn(|k| given[i * Landing::LENGTH + k]) };
    let n = across * across;
    let mut nodes: Vec<Option<[f64; Landing::LENGTH]>> = Vec::with_capacity(n);
    let mut light = vec![1.0; n];
    let mut any = false;
    for i in 0..n {
        let values = given_at(i);
        let l = place(across, i % across, i / across);
        let inside = l[0].hypot(l[1]) <= 1.0 + 1e-9;
        if values.iter().any(|v| v.is_nan()) {
            light[i] = if inside { 0.0 } else { 1.0 };
            nodes.push(None);
            continue;
        }
        let Landing { focused, out_of_focus } = Landing::of(values);
        let far = |v: [f64; 2], most: f64| v[0].hypot(v[1]) > most;
        if inside && far(focused, 1.0) {
            return Err(value_error!(
                "focused must be offsets of at most 1 half diagonal (NaN where no light arrives); got {focused:?} at \
                 field {field}, lens point {l:?}"
            ));
        }
        for (name, v) in ["in_front", "behind"].into_iter().zip(out_of_focus) {
            if inside && far(v, FARTHEST) {
                return Err(value_error!(
                    "{name} must be offsets of at most {FARTHEST} radii (NaN where no light arrives); got {v:?} at \
                     field {field}, lens point {l:?}"
                ));
            }
        }
        any |= inside;
        nodes.push(values.iter().all(|v| v.is_finite()).then_some(values));
    }
    if !any {
        return Err(value_error!("light must arrive through some lens point; at field {field} all are NaN"));
    }
    while nodes.iter().any(Option::is_none) {
        let known = nodes.clone();
        for i in (0..n).filter(|&i| known[i].is_none()) {
            nodes[i] = continued(&known, across, i);
        }
    }
    let nodes = nodes.into_iter().zip(light);
    Ok(nodes.map(|(values, light)| Node { values: values.unwrap_or_default(), light }).collect())
}

/// The value of a node that is unknown: straight on from two known ones in a row, or else that of a known neighbour;
/// the mean over all directions.
fn continued(
    known: &[Option<[f64; Landing::LENGTH]>],
    across: usize,
    i: usize,
) -> Option<[f64; Landing::LENGTH]> {
    let (x, y) = ((i % across) as i64, (i / across) as i64);
    let at = |x: i64, y: i64| {
        let inside = (0..across as i64).contains(&x) && (0..across as i64).contains(&y);
        if inside { known[y as usize * across + x as usize] } else { None }
    };
    let around = || (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|d| *d != (0, 0));
    let mean = |values: Vec<[f64; Landing::LENGTH]>| {
        let n = values.len() as f64;
        (n > 0.0).then(|| std::array::from_fn(|k| values.iter().map(|v| v[k]).sum::<f64>() / n))
    };
    let straight = around().filter_map(|(dx, dy)| {
        let (near, far) = (at(x + dx, y + dy)?, at(x + 2 * dx, y + 2 * dy)?);
        Some(std::array::from_fn(|k| 2.0 * near[k] - far[k]))
    });
    mean(straight.collect()).or_else(|| mean(around().filter_map(|(dx, dy)| at(x + dx, y + dy)).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thin lens, on a grid of `across` points; NaN outside the unit disc.
    fn thin(across: usize) -> Vec<f64> {
        let of_node = |i: usize| {
            let l = place(across, i % across, i / across);
            let outside = l[0].hypot(l[1]) > 1.0 + 1e-9;
            let v = if outside { [f64::NAN; 2] } else { l };
            [0.0, 0.0, v[0], v[1], v[0], v[1]]
        };
        (0..across * across).flat_map(of_node).collect()
    }

    /// A place to the right of the axis.
    fn at(height: f64) -> Place {
        Place { height, away: Direction::RIGHT }
    }

    #[test]
    fn a_grid_is_bilinear_between_its_places_and_bounded_by_them() {
        let across = 9;
        let scaled = |by: f64| thin(across).into_iter().map(move |v| by * v);
        let given = [1.0, 1.2, 1.4, 1.6].into_iter().flat_map(scaled).collect();
        let grid = Fields::Grid([vec![-1.0, 1.0], vec![-0.5, 0.5]]);
        let map = LensMap::new(grid, across, given).unwrap();
        let place =
            |x: f64, y: f64| Place { height: x.hypot(y), away: Direction([x, y].map(|v| v / x.hypot(y))) };
        for (x, y, expected) in [(-1.0, -0.5, 1.0), (1.0, 0.5, 1.6), (0.5, -0.25, 1.25), (9.0, -9.0, 1.2)] {
            let [_, behind] = map.at(place(x, y), [0.3, -0.4]).out_of_focus;
            assert!((behind[0] - 0.3 * expected).abs() < 1e-12 && (behind[1] + 0.4 * expected).abs() < 1e-12);
        }
        let corners = [place(-2.0, -2.0), place(-1.5, 2.0)];
        // The farthest node beside the rim is at (1, 0.75).
        assert!((map.deviation_between(corners, corners).lens - 1.25 * 0.4).abs() < 1e-12);
        assert!((map.deviation(place(0.1, 0.1)).lens - 1.25 * 0.6).abs() < 1e-12);
    }

    #[test]
    fn a_thin_lens_is_itself_up_to_the_rim() {
        for across in [5, 8, 33] {
            let heights = Fields::Heights(vec![0.0, 1.0]);
            let map = LensMap::new(heights, across, [thin(across), thin(across)].concat()).unwrap();
            assert_eq!(map.widest(), 1.0);
            for turn in 0..100 {
                let (sin, cos) = f64::from(turn).sin_cos();
                let rho = (f64::from(turn) / 99.0).sqrt();
                let landing = map.at(at(0.3), [rho * cos, rho * sin]);
                assert!(map.arrives(at(0.3), [rho * cos, rho * sin]) && landing.focused == [0.0; 2]);
                for v in landing.out_of_focus {
                    assert!((v[0] - rho * cos).hypot(v[1] - rho * sin) < 1e-12);
                }
            }
            let Deviation { focused, lens, lost } = map.deviation(at(0.5));
            assert!(focused == 0.0 && lens < 1e-12 && lost == 0.0);
        }
    }

    #[test]
    fn light_is_lost_where_it_is_nan() {
        let across = 33;
        let mut given = thin(across);
        for i in 0..across * across {
            if place(across, i % across, i / across)[0] > 0.5 {
                given[i * Landing::LENGTH] = f64::NAN;
            }
        }
        let map = LensMap::new(Fields::Heights(vec![0.0]), across, given).unwrap();
        assert!(map.arrives(at(0.0), [0.45, 0.3]) && map.arrives(at(0.0), [0.45, -0.8]));
        assert!(!map.arrives(at(0.0), [0.6, 0.3]) && !map.arrives(at(0.0), [0.6, 0.79]));
        assert!((map.deviation(at(0.0)).lost - 0.4375).abs() < 1e-12);
    }

    #[test]
    fn bad_maps_are_named() {
        let good = thin(5);
        let with = |value: f64| {
            let mut given = good.clone();
            given[12 * Landing::LENGTH + 2] = value;
            given
        };
        for (heights, given, name) in [
            (vec![], vec![], "field"),
            (vec![-0.1], good.clone(), "field"),
            (vec![0.5, 0.5], [good.clone(), good.clone()].concat(), "field"),
            (vec![0.0], with(5.0), "in_front"),
            (vec![0.0], with(f64::INFINITY), "in_front"),
            (vec![0.0], vec![f64::NAN; good.len()], "light"),
        ] {
            let error = LensMap::new(Fields::Heights(heights), 5, given).unwrap_err().to_string();
            assert!(error.starts_with(name), "{error}");
        }
    }
}
