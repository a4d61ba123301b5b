//! The cells on a device are those of the scene, bit for bit.

use super::layered::{Cells, NOWHERE};
use crate::cancel::Cancel;
use crate::gpu::commands::Commands;
use crate::gpu::device::Gpu;
use crate::gpu::picture::GpuPicture;
use crate::gpu::tests::on_adapter;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::{Layer, Picture, Size};
use crate::scene::Scene;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use std::ops::Range;
use std::sync::Arc;

const WIDTH: usize = 101;
const HEIGHT: usize = 150;
const WHOLE: Range<usize> = 0..HEIGHT;

/// A value from 0 to 1 for every number: the fraction of its multiple of the golden ratio.
fn hashed(i: usize) -> f32 {
    (i as u32).wrapping_mul(0x9e37_79b9) as f32 / 4_294_967_296.0
}

/// A floor in a slope with `noise`, and before it a steep box and thin bars.
fn disparity(noise: f32) -> Buffer<f32> {
    let at = |i: usize| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let floor = 0.3 * y as f32 / HEIGHT as f32 + noise * (hashed(i) - 0.5);
        match (x, y) {
            (20..60, 30..110) => 0.6 + 0.2 * x as f32 / WIDTH as f32 * y as f32 / HEIGHT as f32,
            (60.., _) if x % 11 < 2 => 0.9 + noise * hashed(i),
            _ => floor,
        }
    };
    (0..WIDTH * HEIGHT).map(at).collect()
}

fn layer(channels: usize, disparity: Buffer<f32>, coverage: impl Fn(usize) -> f32) -> Layer {
    let n = WIDTH * HEIGHT;
    let value = |i: usize| if i / n == 3 { coverage(i % n) } else { hashed(7 * i + 3) };
    Layer::new(Arc::new((0..channels * n).map(value).collect()), disparity)
}

fn of_one_layer(channels: usize, noise: f32) -> Picture {
    let size = Size { width: WIDTH, height: HEIGHT, channels };
    Picture::new(size, vec![layer(channels, disparity(noise), hashed)])
}

/// Some pixels of the first of two layers are empty, and send out light all the same; some are covered in part, and some by
/// a little more than 1, as rounding makes it.
fn of_two_layers() -> Picture {
    let size = Size { width: WIDTH, height: HEIGHT, channels: 4 };
    let first = |i: usize| [0.0, hashed(i), 1.0, 1.0 + 1e-4][i / 7 % 4];
    let second = disparity(0.0).iter().map(|d| d - 0.4).collect();
    Picture::new(size, vec![layer(4, disparity(0.0), first), layer(4, second, |_| 1.0)])
}

fn with_holdouts(picture: Picture) -> Picture {
    let holdout = |d: f32| {
        let alpha = (0..WIDTH * HEIGHT).map(|i| (hashed(i / 13) * 3.0 - 1.0).clamp(0.0, 1.0));
        Layer::new(Arc::new(alpha.collect()), Buffer::full(WIDTH * HEIGHT, d))
    };
    Picture { holdouts: Arc::new(vec![holdout(0.5), holdout(0.75)]), ..picture }
}

/// The words of a buffer.
fn words_of(gpu: &Arc<Gpu>, buffer: &wgpu::Buffer) -> Vec<u32> {
    let cancel = Cancel::default();
    let mut words = vec![0.0; buffer.size() as usize / 4];
    Commands::new(gpu, &cancel).submit(buffer).unwrap().wait(&cancel, &mut words).unwrap();
    words.iter().map(|word: &f32| word.to_bits()).collect()
}

/// Compares the cells of some rows, but for the codes in the first and in the last of them: in the rest of the scene, these
/// have neighbours.
fn assert_are_the_scene_s(gpu: &Arc<Gpu>, cells: &Cells, scene: &LayeredScene, rows: &Range<usize>) {
    let (n, first) = (rows.len() * WIDTH, rows.start * WIDTH);
    let read = |buffer| words_of(gpu, buffer);
    let (codes, shifts, colors) = (read(&cells.codes), read(&cells.shifts), read(&cells.colors));
    let half_planes = read(&cells.half_planes);
    let has_neighbours = |y: usize| (y > rows.start || y == 0) && (y + 1 < rows.end || y + 1 == HEIGHT);
    for (l, (layer, depths)) in scene.layers.iter().zip(&*scene.depths).enumerate() {
        for i in 0..n {
            let (cell, own) = (l * n + i, first + i);
            let at = format!("layer {l}, row {}, column {}", own / WIDTH, own % WIDTH);
            let s = if layer.s[own].is_nan() { NOWHERE } else { layer.s[own] };
            assert_eq!(f32::from_bits(shifts[cell]), s, "shift, {at}");
            let color = layer.colors.at(own).map(f32::to_bits);
            assert_eq!(colors[4 * cell..][..4], color, "colour, {at}");
            let plane = (half_planes[cell] as usize).checked_sub(1).map(|number| {
                let first = n * scene.layers.len() + 4 * number;
                half_planes[first..][..4].to_vec()
            });
            let expected = layer.half_plane_at(own).map(|plane| {
                [plane.normal[0], plane.normal[1], plane.cut, plane.opacity].map(f32::to_bits).to_vec()
            });
            assert_eq!(plane, expected, "half-plane, {at}");
            if has_neighbours(own / WIDTH) {
                let span = u32::from(depths.lo[own]) | u32::from(depths.hi[own]) << 16;
                assert_eq!(codes[cell], span, "codes, {at}");
            }
        }
    }
}

fn assert_cells(picture: Picture, bands: &[Range<usize>]) {
    let gpu = Gpu::open(0).unwrap();
    let (lights, cancel) = (picture.size.channels.min(3), Cancel::default());
    let scene = Scene::new(picture, lights, None, 1);
    let optics = Optics { k: 17.3, d_focus: 0.4 };
    let layered = scene.layered(&scene.picture, &optics, Simd::PORTABLE, &cancel).unwrap();
    for rows in bands {
        let picture = GpuPicture::new(&gpu, &scene.picture, rows, None).unwrap();
        let mut commands = Commands::new(&gpu, &cancel);
        let cells = Cells::new(&mut commands, &picture, &layered, rows).unwrap();
        assert_are_the_scene_s(&gpu, &cells, &layered, rows);
    }
}

#[test]
fn cells_of_one_layer_are_those_of_the_scene() {
    on_adapter(|| {
        for (channels, noise) in [(1, 0.0), (2, 0.0), (3, 0.0), (3, 0.02), (4, 0.0)] {
            assert_cells(of_one_layer(channels, noise), &[WHOLE]);
        }
    });
}

#[test]
fn cells_of_several_layers_and_of_holdouts_are_those_of_the_scene() {
    on_adapter(|| {
        assert_cells(of_two_layers(), &[WHOLE]);
        assert_cells(with_holdouts(of_one_layer(3, 0.0)), &[WHOLE]);
        assert_cells(with_holdouts(of_two_layers()), &[WHOLE]);
    });
}

#[test]
fn cells_of_bands_are_those_of_the_scene() {
    on_adapter(|| {
        let bands = [0..64, 64..128, 128..HEIGHT];
        assert_cells(of_one_layer(3, 0.02), &bands);
        assert_cells(with_holdouts(of_two_layers()), &bands);
    });
}
