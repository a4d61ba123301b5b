//! Shaders, and the layout of their parameters.

/// The layout of the fields of a structure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// The structure's name in WGSL.
    pub name: &'static str,
    /// Its fields, each with its offset in bytes.
    pub fields: &'static [(&'static str, usize)],
    /// Its size in bytes.
    pub size: usize,
}

/// A structure that Rust and shaders share, with the layout that WGSL has for the fields of the same names. Fields
/// whose name begins with an underscore only fill gaps.
macro_rules! shared {
    ($(#[$meta:meta])* $visibility:vis struct $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
        $visibility struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        impl $name {
            /// The layout of its fields.
            pub const LAYOUT: $crate::gpu::shader::Layout = $crate::gpu::shader::Layout {
                name: stringify!($name),
                fields: &[$((stringify!($field), std::mem::offset_of!($name, $field)),)*],
                size: size_of::<$name>(),
            };
        }
    };
}
pub(crate) use shared;

/// A compute shader with one entry point. Binding 0 is the uniform `params`, the following ones are buffers.
#[derive(Debug, Clone, Copy)]
pub struct Shader {
    /// Its path in `shaders/`, without suffix.
    pub name: &'static str,
    /// Its WGSL source.
    pub source: &'static str,
    /// The structures that it shares with Rust.
    #[cfg_attr(
        not(all(test, feature = "test-shaders")),
        allow(dead_code, reason = "the tests compare layouts")
    )]
    pub shared: &'static [Layout],
}

impl Shader {
    /// The values of its constants for pictures with this number of channels; not all shaders use them.
    pub fn constants(&self, channels: usize) -> Vec<(&'static str, f64)> {
        let asks = self.source.contains("override CHANNELS");
        asks.then_some(("CHANNELS", channels as f64)).into_iter().collect()
    }
}

/// A shader by its path in `shaders/`, the files that it includes, and the structures that it shares.
macro_rules! shader {
    ($name:literal, [$($part:literal),*], [$($shared:ty),*]) => {
        $crate::gpu::shader::Shader {
            name: $name,
            source: concat!(
                $(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $part, ".wgsl")),)*
                include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $name, ".wgsl"))
            ),
            shared: &[$(<$shared>::LAYOUT),*],
        }
    };
}
pub(crate) use shader;

shared! {
    /// `Defocus` of `shaders/defocus.wgsl`.
    pub struct Defocus {
        scale: f32,
        d_focus: f32,
        measure: u32,
    }
}

impl From<crate::optics::Defocus> for Defocus {
    fn from(defocus: crate::optics::Defocus) -> Defocus {
        Defocus {
            scale: defocus.scale as f32,
            d_focus: defocus.d_focus as f32,
            measure: defocus.measure as u32,
        }
    }
}

#[cfg(feature = "test-shaders")]
pub mod perturbed;
#[cfg(all(test, feature = "test-shaders"))]
mod portable_tests;
#[cfg(all(test, feature = "test-shaders"))]
mod tests;
