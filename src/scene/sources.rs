//! The files of a scene: the file itself, material libraries, textures and buffers.
//!
//! All are read here, so that each is a regular file below the limit of size, is decoded once, and is listed.

use super::{Repairs, names::counted, texture::Texture};
use crate::error::{is_obeyed, shown};
use crate::files::input::{Input, MAX_SMALL_FILE, guarded};
use crate::{Error, Result, memory};
use indexmap::IndexSet;
use std::{
    collections::HashMap,
    hash::Hash,
    path::{Path, PathBuf},
};

/// Largest number of messages about unreadable files; the others are counted. A file of some kilobytes can name
/// thousands, and a screen holds about as many lines.
const MAX_MESSAGES: usize = 20;

/// Reads the files of one scene.
pub(super) struct Sources {
    /// Largest file, and largest sum of decoded textures, bytes.
    limit: u64,
    /// Whether the scene is in memory without a folder: it must not name files.
    pub is_closed: bool,
    /// Files that were read, in order, without repetition.
    pub read: IndexSet<PathBuf>,
    /// Files that were looked for and could not be opened, in order, without repetition.
    pub unread: IndexSet<PathBuf>,
    textures: HashMap<TextureKey, Option<Texture>>,
    texture_bytes: u64,
}

/// Place of the encoded bytes of a texture.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum TextureKey {
    File(PathBuf),
    /// Index of the first image of a glTF file that has these bytes.
    Image(usize),
}

impl Sources {
    /// `max_memory`: largest memory of the scene, bytes; `None` for [`memory::USABLE_FRACTION`] of the available memory.
    pub fn new(max_memory: Option<u64>) -> Sources {
        let limit = max_memory.or_else(memory::usable).unwrap_or(u64::MAX >> 1);
        Sources {
            limit,
            is_closed: false,
            read: IndexSet::new(),
            unread: IndexSet::new(),
            textures: HashMap::new(),
            texture_bytes: 0,
        }
    }

    /// Opens a file that may take all memory.
    pub fn open(&mut self, path: &Path) -> Result<Input> {
        self.open_up_to(path, self.limit)
    }

    /// All bytes of a file that may take all memory.
    pub fn bytes(&mut self, path: &Path) -> Result<Vec<u8>> {
        self.open(path)?.bytes()
    }

    /// All bytes of a file of definitions.
    pub fn small(&mut self, path: &Path) -> Result<Vec<u8>> {
        self.open_up_to(path, MAX_SMALL_FILE.min(self.limit))?.bytes()
    }

    /// The files that were read, and those that could not be opened.
    pub fn lists(self) -> (Vec<PathBuf>, Vec<PathBuf>) {
        (self.read.into_iter().collect(), self.unread.into_iter().collect())
    }

    /// Lists a file that was looked for and does not exist.
    pub fn missed(&mut self, path: PathBuf) {
        self.unread.insert(path);
    }

    fn open_up_to(&mut self, path: &Path, limit: u64) -> Result<Input> {
        if self.is_closed {
            return Err(Error::arguments(format!(
                "the scene names the file `{}`: give ⟨folder⟩, where it is looked for, or leave it out of the scene",
                shown(path)
            )));
        }
        let opened = Input::open(path, limit);
        let list = if opened.is_ok() { &mut self.read } else { &mut self.unread };
        if !list.contains(path) {
            list.insert(path.into());
        }
        opened
    }

    /// The texture `key`, whose encoded bytes are `read` once, whatever names lead to its file; `None`, with a counted repair, if it
    /// cannot be read.
    ///
    /// # Errors
    /// The textures of the scene take more memory than allowed, or the scene must not name files.
    pub fn texture(
        &mut self,
        scene: &Path,
        key: &TextureKey,
        repairs: &mut Repairs,
        read: impl FnOnce(&mut Sources) -> Result<Vec<u8>>,
    ) -> Result<Option<Texture>> {
        if let Some(known) = self.textures.get(key) {
            return Ok(known.clone());
        }
        let place = self.place(key);
        if let Some(known) = place.as_ref().and_then(|place| self.textures.get(place)).cloned() {
            self.textures.insert(key.clone(), known.clone());
            return Ok(known);
        }
        let file = match key {
            TextureKey::File(path) => path.clone(),
            TextureKey::Image(number) => format!("image {number} of {}", scene.display()).into(),
        };
        let left = self.limit.saturating_sub(self.texture_bytes);
        let decoded = read(self).and_then(|bytes| guarded(&file, || Texture::decode(&file, &bytes, left)));
        let texture = match decoded {
            Err(error @ (Error::OutOfMemory(_) | Error::Argument { .. })) => return Err(error),
            Err(error) => {
                let why = match &error {
                    Error::Io { source, .. } => source.to_string(),
                    Error::File { what, .. } => what.clone(),
                    other => other.to_string(),
                };
                repairs.unreadable(&format!("texture {}: {why}", shown(&file)));
                None
            }
            Ok(texture) => Some(texture),
        };
        self.texture_bytes += texture.as_ref().map_or(0, Texture::bytes);
        for key in place.into_iter().chain([key.clone()]) {
            self.textures.insert(key, texture.clone());
        }
        Ok(texture)
    }

    /// The key of an existing file by its path without links, `.` and `..`.
    fn place(&self, key: &TextureKey) -> Option<TextureKey> {
        match key {
            TextureKey::File(path) if !self.is_closed => path.canonicalize().ok().map(TextureKey::File),
            _ => None,
        }
    }
}

impl Repairs {
    /// Counts a file that could not be read.
    pub(super) fn unreadable(&mut self, message: &str) {
        self.missing_files += 1;
        match self.missing_files {
            n if n <= MAX_MESSAGES => {
                self.messages.push(message.chars().filter(|c| !is_obeyed(*c)).collect())
            }
            n => {
                let text = |more| format!("{} could not be read", counted(more, "more file"));
                let before = text(n - 1 - MAX_MESSAGES);
                match self.messages.iter_mut().rfind(|message| **message == before) {
                    Some(last) => *last = text(n - MAX_MESSAGES),
                    None => self.messages.push(text(n - MAX_MESSAGES)),
                }
            }
        }
    }
}

/// The text of a file, in any encoding, with line feeds only as ends of lines.
pub(super) fn text_of(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    match text.contains('\r') {
        true => text.replace("\r\n", "\n").replace('\r', "\n"),
        false => text.into_owned(),
    }
}

/// The path that a scene file states, for messages: shortened, and found from the folder of the scene.
pub(super) fn beside(scene: &Path, name: &str) -> PathBuf {
    scene.with_file_name("").join(name.replace('\\', "/"))
}
