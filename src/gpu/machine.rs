//! What this machine has of what a GPU needs, and what it lacks: containers often lack one thing of several.

/// Whether there may be a GPU. To be certain, all drivers have to be loaded, which takes long if the only one is a
/// software rasteriser.
pub fn may_have_gpu() -> bool {
    #[cfg(target_os = "linux")]
    return !linux::device_files().is_empty();
    #[cfg(not(target_os = "linux"))]
    return true;
}

/// What is missing on a machine on which no GPU was found: a sentence for each cause.
pub fn missing() -> Vec<String> {
    #[cfg(target_os = "linux")]
    return linux::Machine::look().missing();
    #[cfg(not(target_os = "linux"))]
    return vec!["A GPU needs its maker's driver for Vulkan, Metal or Direct3D 12.".to_owned()];
}

#[cfg(target_os = "linux")]
mod linux {
    use std::ffi::{CStr, CString, OsStr};
    use std::os::unix::ffi::OsStrExt;
    use std::path::{Path, PathBuf};

    const NVIDIA: &str = "/dev/nvidiactl";
    /// Variables that name drivers in place of the folders in which Vulkan's loader finds them.
    const NAMED: [&str; 2] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];

    /// What there is of all that a GPU needs.
    pub struct Machine {
        /// The device files of GPUs, and whether this user may open each of them.
        pub device_files: Vec<(PathBuf, bool)>,
        /// Why Vulkan's loader cannot be loaded, if it cannot.
        pub loader: Result<(), String>,
        /// The files in which drivers for Vulkan are described.
        pub drivers: Vec<PathBuf>,
        /// The variable that names them, and its value.
        pub named: Option<(&'static str, String)>,
        /// What NVIDIA's toolkit is asked to put into a container.
        pub capabilities: Option<String>,
    }

    /// Linux has a device file for every GPU, and for the devices that a virtual machine is lent.
    pub fn device_files() -> Vec<PathBuf> {
        let renders = |path: &PathBuf| {
            path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("renderD"))
        };
        let single = [NVIDIA, "/dev/dxg"].map(PathBuf::from).into_iter().filter(|path| path.exists());
        single.chain(entries(Path::new("/dev/dri")).into_iter().filter(renders)).collect()
    }

    /// The files of a folder in alphabetical order; none if it cannot be read.
    fn entries(folder: &Path) -> Vec<PathBuf> {
        let found = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut found: Vec<PathBuf> = found.map(|entry| entry.path()).collect();
        found.sort();
        found
    }

    /// Whether this user may read and write a file. It is not opened, which might wake a GPU that sleeps.
    fn may_open(path: &Path) -> bool {
        // SAFETY: the path is a string with a nul at its end.
        CString::new(path.as_os_str().as_bytes())
            .is_ok_and(|path| unsafe { libc::access(path.as_ptr(), libc::R_OK | libc::W_OK) == 0 })
    }

    /// Why a library cannot be loaded, if it cannot.
    fn load(name: &CStr) -> Result<(), String> {
        // SAFETY: the library is Vulkan's loader, whose initialisation needs nothing of this program, and the text of
        // an error is copied before another call of this thread may change it.
        unsafe {
            let library = libc::dlopen(name.as_ptr(), libc::RTLD_LAZY | libc::RTLD_LOCAL);
            if !library.is_null() {
                libc::dlclose(library);
                return Ok(());
            }
            let error = libc::dlerror();
            let error = if error.is_null() { name } else { CStr::from_ptr(error) };
            Err(error.to_string_lossy().into_owned())
        }
    }

    fn variable(name: &str) -> Option<String> {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(|value| value.to_string_lossy().into_owned())
    }

    /// The folders in which Vulkan's loader looks for drivers, in its order.
    fn driver_folders() -> Vec<PathBuf> {
        let of_home = |name: &str, default: &str| {
            variable(name).or_else(|| variable("HOME").map(|home| format!("{home}/{default}")))
        };
        let of_all = |name: &str, default: &str| variable(name).unwrap_or_else(|| default.to_owned());
        let lists = [
            of_home("XDG_CONFIG_HOME", ".config").unwrap_or_default(),
            of_all("XDG_CONFIG_DIRS", "/etc/xdg"),
            "/usr/local/etc:/etc".to_owned(),
            of_home("XDG_DATA_HOME", ".local/share").unwrap_or_default(),
            of_all("XDG_DATA_DIRS", "/usr/local/share:/usr/share"),
        ];
        let folders = lists.iter().flat_map(|list| list.split(':')).filter(|folder| !folder.is_empty());
        folders.map(|folder| Path::new(folder).join("vulkan/icd.d")).collect()
    }

    fn drivers(named: Option<&str>) -> Vec<PathBuf> {
        let describes = |path: &PathBuf| path.extension() == Some(OsStr::new("json"));
        let in_folder = |folder: PathBuf| entries(&folder).into_iter().filter(describes);
        let Some(named) = named else { return driver_folders().into_iter().flat_map(in_folder).collect() };
        let paths = named.split(':').map(PathBuf::from);
        let (folders, files): (Vec<_>, Vec<_>) = paths.partition(|path| path.is_dir());
        let files = files.into_iter().filter(|path| path.is_file());
        files.chain(folders.into_iter().flat_map(in_folder)).collect()
    }

    impl Machine {
        /// What this machine has.
        pub fn look() -> Machine {
            let named = NAMED.into_iter().find_map(|name| variable(name).map(|value| (name, value)));
            let files = device_files().into_iter();
            Machine {
                device_files: files.map(|path| (path.clone(), may_open(&path))).collect(),
                loader: load(c"libvulkan.so.1"),
                drivers: drivers(named.as_ref().map(|(_, value)| value.as_str())),
                named,
                capabilities: variable("NVIDIA_DRIVER_CAPABILITIES"),
            }
        }

        /// A sentence for each thing that is missing.
        pub fn missing(&self) -> Vec<String> {
            let Machine { device_files, loader, drivers, named, capabilities } = self;
            let mut sentences = Vec::new();
            if device_files.is_empty() {
                sentences.push(
                    "There is no device file of a GPU (/dev/nvidiactl, /dev/dri/renderD*): Docker gives a container \
                     one with --gpus all (NVIDIA) or --device /dev/dri (AMD, Intel)."
                        .to_owned(),
                );
            }
            for (path, _) in device_files.iter().filter(|(_, may_open)| !may_open) {
                sentences.push(format!(
                    "This user may not open {}: it belongs to a group, often render or video, that the user has to \
                     be in.",
                    path.display()
                ));
            }
            if let Err(error) = loader {
                sentences.push(format!(
                    "Vulkan's loader cannot be loaded ({error}): install libvulkan1 (Debian, Ubuntu) or \
                     vulkan-loader (Fedora)."
                ));
            }
            match named {
                Some((name, value)) if drivers.is_empty() => sentences
                    .push(format!("The environment variable {name} names no driver that exists: {value:?}.")),
                None if drivers.is_empty() => sentences.push(
                    "No driver for Vulkan is listed in /usr/share/vulkan/icd.d or /etc/vulkan/icd.d: install \
                     mesa-vulkan-drivers for AMD and Intel; NVIDIA's driver brings its own."
                        .to_owned(),
                ),
                _ => {}
            }
            sentences.extend(self.missing_of_nvidia());
            if sentences.is_empty() {
                let names = drivers.iter().filter_map(|path| path.file_name());
                let names: Vec<_> = names.map(|name| name.to_string_lossy()).collect();
                sentences.push(format!(
                    "The drivers for Vulkan ({}) find no GPU that they know{}.",
                    names.join(", "),
                    capabilities.as_ref().map_or("", |_| "; the one on the host may be too old")
                ));
            }
            sentences
        }

        /// What an NVIDIA GPU lacks: its driver for Vulkan comes into a container only on demand.
        fn missing_of_nvidia(&self) -> Option<String> {
            const ASK: &str = "NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility";
            if !self.device_files.iter().any(|(path, _)| path == Path::new(NVIDIA)) {
                return None;
            }
            if let Some(asked) = &self.capabilities {
                let brings = |word: &str| matches!(word.trim(), "graphics" | "all");
                if !asked.split(',').any(brings) {
                    return Some(format!(
                        "NVIDIA_DRIVER_CAPABILITIES is {asked:?}, without graphics, which is Vulkan: start the \
                         container with {ASK}."
                    ));
                }
            }
            let is_of_nvidia = |path: &PathBuf| {
                path.file_name().is_some_and(|name| name.to_string_lossy().contains("nvidia"))
            };
            if self.drivers.iter().any(is_of_nvidia) || self.named.is_some() {
                return None;
            }
            Some(format!(
                "There is an NVIDIA GPU, but not its driver for Vulkan (nvidia_icd.json): a container is given it \
                 with {ASK}; elsewhere it is a part of NVIDIA's whole driver (Debian: nvidia-vulkan-icd)."
            ))
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        /// A machine with an NVIDIA GPU and all that it needs.
        fn whole() -> Machine {
            Machine {
                device_files: vec![(PathBuf::from(NVIDIA), true)],
                loader: Ok(()),
                drivers: vec![PathBuf::from("/etc/vulkan/icd.d/nvidia_icd.json")],
                named: None,
                capabilities: Some("graphics,compute,utility".to_owned()),
            }
        }

        #[test]
        fn each_cause_has_one_sentence_of_its_own() {
            let render = || vec![(PathBuf::from("/dev/dri/renderD128"), false)];
            let lost = || Err("libvulkan.so.1: cannot open shared object file".to_owned());
            let named = || Some(("VK_DRIVER_FILES", "/nowhere".to_owned()));
            let asked = |words: &str| Some(words.to_owned());
            let cases = [
                (Machine { device_files: Vec::new(), ..whole() }, "no device file of a GPU"),
                (Machine { device_files: render(), ..whole() }, "may not open /dev/dri/renderD128"),
                (
                    Machine { loader: lost(), ..whole() },
                    "Vulkan's loader cannot be loaded (libvulkan.so.1: cannot",
                ),
                (
                    Machine { drivers: Vec::new(), named: named(), ..whole() },
                    "VK_DRIVER_FILES names no driver",
                ),
                (
                    Machine { capabilities: asked("compute,utility"), ..whole() },
                    "is \"compute,utility\", without",
                ),
                (Machine { drivers: vec!["lvp.json".into()], ..whole() }, "not its driver for Vulkan"),
                (whole(), "(nvidia_icd.json) find no GPU that they know; the one on the host may be too old"),
                (Machine { capabilities: asked("all"), ..whole() }, "find no GPU that they know"),
            ];
            for (machine, words) in cases {
                let missing = machine.missing();
                assert!(missing.len() == 1 && missing[0].contains(words), "{words}: {missing:?}");
            }
        }

        #[test]
        fn several_causes_are_all_named() {
            let bare =
                Machine { device_files: Vec::new(), drivers: Vec::new(), loader: load(c"no.so"), ..whole() };
            let missing = bare.missing();
            assert_eq!(missing.len(), 3, "{missing:?}");
            assert!(missing[1].contains("no.so") && missing[2].contains("No driver for Vulkan is listed"));
        }
    }
}
