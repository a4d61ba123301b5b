//! Hashes of settings.

use std::hash::{DefaultHasher, Hash, Hasher};

/// Hash of the text of a settings value. A negative zero equals a plain one.
pub fn hash_text(text: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    for word in text.split([' ', '=', ',', '(', ')']) {
        let word = if word == "-0.0" { "0.0" } else { word };
        word.hash(&mut hasher);
    }
    hasher.finish()
}
