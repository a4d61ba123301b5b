//! An error on a device is returned as an error, and the next call works. Nothing is tested if there is no adapter;
//! `tests/conftest.py` counts the tests that run.

use super::adapters;
use super::commands::Commands;
use super::device::{Gpu, lock};
use super::idle::IDLE;
use super::process_local::ProcessLocal;
use super::render::{Exposure, Scope};
use super::scene_cache::SceneCache;
use crate::cancel::Cancel;
use crate::device::Device;
use crate::error::Error;
use crate::method::Method;
use crate::optics::{Frame, Imaging, Lens, Strength};
use crate::picture::{Layer, Picture, Size};
use crate::plan::taps::{Settings, Variant};
use crate::renderer::Renderer;
use crate::scene::Scene;
use crate::simd::Simd;
use std::sync::{Arc, Mutex, PoisonError};

/// Each test has the devices to itself, because it breaks them.
static ALONE: Mutex<()> = Mutex::new(());

/// A lens over a frame of any size.
fn lens() -> Imaging {
    let lens = Lens::from_disparity(Strength::Px(4.0), 0.5).unwrap();
    Frame::plain(300, 200).imaging(&lens).unwrap()
}

fn picture(width: usize, height: usize) -> Picture {
    let size = Size { width, height, channels: 3 };
    let value = |i: usize| ((i * 7919) % 1000) as f32 / 1000.0;
    let color = Arc::new((0..3 * size.pixels()).map(value).collect());
    Picture::new(size, vec![Layer::new(color, (0..size.pixels()).map(value).collect())])
}

fn taps() -> Method {
    Method::Taps(Settings::new(Variant::Thirteen, None).unwrap())
}

/// A renderer of a picture, and memory for its result.
fn renderer(width: usize, height: usize) -> (Renderer, Vec<f32>) {
    (Renderer::new(picture(width, height), 3, None, 1), vec![0.0; 3 * width * height])
}

fn render((renderer, out): &(Renderer, Vec<f32>), device: Device) -> crate::error::Result<Vec<f32>> {
    let (mut out, cancel) = (out.clone(), Cancel::default());
    renderer.render_each(&[lens()], &taps(), device, Simd::PORTABLE, &cancel, vec![&mut out])?;
    Ok(out)
}

/// Runs a test on the first adapter, if there is one.
pub fn on_adapter(test: impl FnOnce()) {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    if adapters::all().is_empty() {
        println!("SKIPPED: there is no adapter");
    } else {
        test();
    }
}

#[test]
fn a_device_that_was_lost_is_an_error_and_then_another_is_opened() {
    on_adapter(|| {
        let scene = renderer(300, 200);
        let expected = render(&scene, Device::Gpu(0)).unwrap();
        let gpu = Gpu::open(0).unwrap();
        gpu.device.destroy();
        // The loss may be noticed by the call during which it happens, or before the next one.
        let first = render(&scene, Device::Gpu(0));
        if let Err(error) = &first {
            assert!(matches!(error, Error::Device(_)), "{error:?}");
        }
        assert_eq!(render(&scene, Device::Gpu(0)).unwrap(), expected);
        assert!(!Arc::ptr_eq(&gpu, &Gpu::open(0).unwrap()));
    });
}

#[test]
fn a_device_that_is_lost_while_it_works_is_an_error() {
    on_adapter(|| {
        let gpu = Gpu::open(0).unwrap();
        let scene = Scene::new(picture(1500, 1000), 3, None, 1);
        let (cache, method, cancel) = (SceneCache::default(), taps(), Cancel::default());
        let simd = Simd::PORTABLE;
        let scope = Scope { scene: &scene, cache: &cache, method: &method, simd, cancel: &cancel };
        let start = |gpu: &Arc<Gpu>| {
            let imaging = lens();
            let exposure = Exposure::new(gpu, &scope, &imaging).unwrap();
            exposure.start(&exposure.bands[0])
        };
        let pending = start(&gpu).unwrap();
        gpu.device.destroy();
        let error = pending.wait(&cancel, &mut vec![0.0; 3 * 1500 * 1000]).err();
        assert!(matches!(error, Some(Error::Device(_))), "{error:?}");
        gpu.retire();
        assert!(start(&Gpu::open(0).unwrap()).is_ok());
    });
}

#[test]
fn a_wait_can_be_cancelled() {
    on_adapter(|| {
        let scene = renderer(2000, 1500);
        let cancel = Cancel::default();
        cancel.cancel();
        let (lenses, device, mut out) = ([lens()], Device::Gpu(0), scene.1.clone());
        let result = scene.0.render_each(&lenses, &taps(), device, Simd::PORTABLE, &cancel, vec![&mut out]);
        // A device that has finished before the first check has nothing to cancel.
        assert!(matches!(result, Ok(_) | Err(Error::Cancelled)), "{:?}", result.err());
        assert!(render(&scene, Device::Gpu(0)).is_ok());
    });
}

#[test]
fn what_does_not_fit_is_refused_with_its_size() {
    on_adapter(|| {
        let gpu = Gpu::open(0).unwrap();
        let most = gpu.limits.max_storage_buffer_binding_size.min(gpu.limits.max_buffer_size);
        let text = Commands::new(&gpu, &Cancel::default())
            .scratch::<u8>("the test", most as usize + 1)
            .unwrap_err()
            .to_string();
        let mebibytes = format!("the device allows {} MiB", most.div_ceil(1 << 20));
        assert!(text.contains("the test would need") && text.contains(&mebibytes), "{text}");
    });
}

#[test]
fn what_the_device_refuses_is_an_error_and_no_panic() {
    on_adapter(|| {
        let gpu = Gpu::open(0).unwrap();
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::STORAGE;
        let refused = gpu.guarded(|| gpu.buffer("the test", 16, usage));
        assert!(matches!(refused, Err(Error::Device(_))));
        // The same without a scope around it.
        drop(gpu.buffer("the test", 16, usage));
        assert!(matches!(gpu.check(), Err(Error::Device(_))));
        assert!(!Arc::ptr_eq(&gpu, &Gpu::open(0).unwrap()));
    });
}

#[test]
fn memory_that_nothing_is_kept_in_is_given_back_when_the_device_is_idle() {
    on_adapter(|| {
        let scene = renderer(1500, 1000);
        assert!(render(&scene, Device::Gpu(0)).is_ok());
        drop(scene);
        let gpu = Gpu::open(0).unwrap();
        let spare = || lock(&gpu.spare).len() + lock(&gpu.spare_back).len();
        assert!(spare() > 0);
        for _ in 0..100 {
            if spare() == 0 {
                break;
            }
            std::thread::sleep(IDLE / 10);
        }
        assert_eq!(spare(), 0);
    });
}

#[test]
fn values_of_a_process_are_dropped_in_it() {
    let value = Arc::new(());
    let owned = ProcessLocal::new(Arc::clone(&value));
    assert!(owned.get().is_some());
    drop(owned);
    assert_eq!(Arc::strong_count(&value), 1);
}
