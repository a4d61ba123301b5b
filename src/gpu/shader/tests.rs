use super::Shader;
use crate::aperture;
use crate::gpu::commands::GROUP;
use crate::gpu::{
    by_focus, carried, falloff, gaussian, hexagonal, lens, levels, magnify, poisson, resolve, sprites, taps,
};
use crate::optics::Measure;
use crate::plan::lens::Missed;
use crate::plan::lens::footprint::Sharpening;
use crate::plan::poisson::LeakTest;
use crate::plan::taps::Mix;
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::TILE;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Expression, Literal, Module, TypeInner, front::wgsl};
use std::collections::BTreeSet;
use std::path::Path;

/// All shaders.
pub const SHADERS: [Shader; 33] = [
    by_focus::BY_FOCUS,
    carried::CARRIED,
    falloff::FALLOFF,
    gaussian::HALVE,
    gaussian::BLUR_X,
    gaussian::BLUR_Y,
    gaussian::COMPOSITE,
    lens::IN_FOCUS,
    lens::layered::CELLS,
    lens::layered::SPANS,
    lens::layered::CHANNELS,
    lens::replace::REPLACE_COLORS,
    lens::group::INTERLEAVE,
    lens::colors::WIDEN,
    lens::colors::SHARPEN,
    lens::disc::SUM_ROWS,
    lens::disc::DISC,
    lens::sweep::SWEEP,
    lens::highlights::HIGHLIGHTS,
    hexagonal::GATHER,
    hexagonal::SHADE,
    levels::REDUCE,
    levels::FILTER,
    levels::INTERPOLATE,
    magnify::MAGNIFY,
    poisson::POISSON,
    resolve::RESOLVE,
    sprites::BIN,
    sprites::GATHER,
    sprites::BEHIND,
    sprites::REST,
    sprites::IN_FRONT,
    taps::TAPS,
];

/// The number of storage buffers that WebGPU guarantees to a pass.
const MOST_BUFFERS: usize = 8;

/// Validates a shader with only those capabilities that every GPU has.
pub fn validated(shader: &Shader) -> (Module, ModuleInfo) {
    let module = wgsl::parse_str(shader.source)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(shader.source)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}: {}", shader.name, error.emit_to_string(shader.source)));
    (module, info)
}

fn files(folder: &Path, found: &mut Vec<(String, String)>) {
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        if entry.path().is_dir() {
            files(&entry.path(), found);
        } else {
            let name = entry.path().with_extension("");
            let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
            let name = name.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
            found.push((name, std::fs::read_to_string(entry.path()).unwrap()));
        }
    }
}

#[test]
fn every_shader_is_tested_here_and_has_one_entry_point() {
    let mut found = Vec::new();
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders"), &mut found);
    for (name, text) in found {
        let entries = text.matches("@compute").count();
        let tested = SHADERS.iter().filter(|shader| shader.name == name).count();
        assert!(entries <= 1 && entries == tested, "{name}: {entries} entry points, tested {tested} times");
    }
    for shader in &SHADERS {
        assert_eq!(validated(shader).0.entry_points.len(), 1, "{}", shader.name);
    }
}

#[test]
fn structures_lie_as_in_rust() {
    for shader in &SHADERS {
        let (module, _) = validated(shader);
        for layout in shader.shared {
            // Several shaders have parameters of their own, which are all named `Params` in WGSL.
            let name = if layout.name.ends_with("Params") { "Params" } else { layout.name };
            let found = module.types.iter().find_map(|(_, ty)| match &ty.inner {
                TypeInner::Struct { members, span } if ty.name.as_deref() == Some(name) => {
                    Some((members, span))
                }
                _ => None,
            });
            let (members, span) = found.unwrap_or_else(|| panic!("{}: no {name}", shader.name));
            let offset = |member: &naga::StructMember| (member.name.clone().unwrap(), member.offset as usize);
            let wgsl: Vec<_> = members.iter().map(offset).collect();
            let fields = layout.fields.iter().filter(|(field, _)| !field.starts_with('_'));
            let rust: Vec<_> = fields.map(|&(field, offset)| (field.to_owned(), offset)).collect();
            assert_eq!(wgsl, rust, "{}: {}", shader.name, layout.name);
            // Parameters are rounded up to 16 bytes when they are uploaded.
            let size = if name == "Params" { layout.size.next_multiple_of(16) } else { layout.size };
            let fits = if name == "Params" { *span as usize <= size } else { *span as usize == size };
            assert!(fits, "{}: {} has {span} bytes, {size} in Rust", shader.name, layout.name);
        }
    }
}

/// Constants that both shaders and Rust state: a part of the shader's name, the constant, and Rust's value.
const STATED_TWICE: [(&str, &str, f64); 23] = [
    ("levels/filter", "GROUP", GROUP as f64),
    ("lens/", "NOWHERE", lens::layered::NOWHERE as f64),
    ("lens/", "NO_PLANES", lens::layered::NO_PLANES as f64),
    ("lens/spans", "MOST", (DepthCodes::MAX - 1) as f64),
    ("lens/", "NO_EDGES", lens::edges::NO_EDGES as f64),
    ("lens/", "OF_HOLDOUT", lens::edges::OF_HOLDOUT as f64),
    ("lens/sharpen", "GUIDED", Sharpening::Guided as u32 as f64),
    ("lens/sharpen", "NEVER", Sharpening::Never as u32 as f64),
    ("lens/sweep", "MISSED_NOTHING", Missed::Nothing as u32 as f64),
    ("lens/sweep", "BATCH", lens::sweep::BATCH as f64),
    ("lens/sweep", "CAPACITY", lens::sweep::CAPACITY as f64),
    ("lens/sweep", "ROWS", (lens::sweep::ROWS / lens::frame::GROUP_ROWS) as f64),
    ("lens/in_focus", "ROUNDING", aperture::ROUNDING as f64),
    ("lens/highlights", "NOT_HIDDEN", lens::highlights::NOT_HIDDEN as f64),
    ("taps", "MIX_BOTH", Mix::Both as u32 as f64),
    ("", "SHIFT", Measure::Shift as u32 as f64),
    ("poisson", "LEAK_TEST_ON", LeakTest::On as u32 as f64),
    ("sprites/gather", "GROUP", GROUP as f64),
    ("sprites/", "BIN_COLUMNS", sprites::BIN_SIZE[0] as f64),
    ("sprites/", "BIN_ROWS", sprites::BIN_SIZE[1] as f64),
    ("sprites/", "SPAN", sprites::SPAN as f64),
    ("sprites/", "IN_FRONT", sprites::Depth::InFront as u32 as f64),
    ("sprites/", "BEHIND", sprites::Depth::Behind as u32 as f64),
];
/// Constants that only shaders use.
const OF_SHADERS: [&str; 8] =
    ["BEYOND", "CAPACITY", "FARTHEST", "LEAST_TOTAL", "MARGIN", "SIDE", "TAU", "THREADS"];

/// Threads of a shader's workgroups along each axis, as the passes expect them.
fn threads(shader: &str) -> [u32; 3] {
    let [width, height] = match shader {
        "lens/in_focus" | "lens/disc" | "lens/sweep" | "lens/highlights" => [TILE.0, lens::frame::GROUP_ROWS],
        "sprites/bin" => sprites::BIN_SIZE,
        "sprites/rest" => [sprites::SPAN, 1],
        "lens/sum_rows" => [256, 1],
        _ => [GROUP, GROUP],
    };
    [width as u32, height as u32, 1]
}

#[test]
fn constants_and_workgroups_are_as_in_rust() {
    let mut compared = BTreeSet::new();
    for shader in &SHADERS {
        let (module, _) = validated(shader);
        assert_eq!(module.entry_points[0].workgroup_size, threads(shader.name), "{}", shader.name);
        for (_, constant) in module.constants.iter() {
            let name = constant.name.as_deref().unwrap();
            let value = match module.global_expressions[constant.init] {
                Expression::Literal(Literal::U32(v)) => f64::from(v),
                Expression::Literal(Literal::I32(v)) => f64::from(v),
                Expression::Literal(Literal::F32(v)) => f64::from(v),
                ref other => panic!("{}: {name} is {other:?}", shader.name),
            };
            let stated = |&&(part, of, _): &&(&str, &str, f64)| shader.name.contains(part) && of == name;
            match STATED_TWICE.iter().find(stated) {
                Some((_, _, rust)) => assert_eq!(value, *rust, "{}: {name}", shader.name),
                None => assert!(OF_SHADERS.contains(&name), "{}: {name} is on no list", shader.name),
            }
            compared.insert(name.to_owned());
        }
    }
    assert!(STATED_TWICE.iter().all(|(_, name, _)| compared.contains(*name)), "{compared:?}");
}

#[test]
fn shaders_are_portable() {
    for shader in &SHADERS {
        let (module, info) = validated(shader);
        let entry = &module.entry_points[0];
        let threads: u32 = entry.workgroup_size.iter().product();
        assert!(threads <= 256, "{}: {threads} threads in a workgroup", shader.name);
        let storage = module
            .global_variables
            .iter()
            .filter(|(_, variable)| matches!(variable.space, naga::AddressSpace::Storage { .. }));
        assert!(storage.count() <= MOST_BUFFERS, "{}: too many storage buffers", shader.name);
        for channels in 1..=4 {
            translate(shader, &module, &info, channels);
        }
    }
}

/// Translates a shader to the languages of Vulkan, Metal and Direct3D.
fn translate(shader: &Shader, module: &Module, info: &ModuleInfo, channels: usize) {
    use naga::back::{PipelineConstants, hlsl, msl, pipeline_constants::process_overrides, spv};
    let constants = shader.constants(channels).into_iter();
    let constants: PipelineConstants = constants.map(|(name, value)| (name.to_owned(), value)).collect();
    let (module, info) = process_overrides(module, info, None, &constants).unwrap();

    spv::write_vec(&module, &info, &spv::Options::default(), None)
        .unwrap_or_else(|error| panic!("{} to SPIR-V: {error}", shader.name));
    let options = hlsl::Options { fake_missing_bindings: true, ..Default::default() };
    let pipeline = hlsl::PipelineOptions::default();
    let mut text = String::new();
    hlsl::Writer::new(&mut text, &options, &pipeline)
        .write(&module, &info, None)
        .unwrap_or_else(|error| panic!("{} to HLSL: {error}", shader.name));
    let options = msl::Options { fake_missing_bindings: true, ..Default::default() };
    msl::write_string(&module, &info, &options, &msl::PipelineOptions::default())
        .unwrap_or_else(|error| panic!("{} to Metal: {error}", shader.name));
}
