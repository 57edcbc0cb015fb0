//! The file that keeps the root keys: for its owner's eyes only, and written whole or not at all.
//!
//! TOML: `format = 1`, `control_boots` (how often a control center has started with these keys), `control_key` (what it makes fresh
//! keys of), and one `[[drone]]` with `id`,
//! `key` (64 hexadecimal digits) and, once the key was given to a drone, `exported = true` for each drone.
//!
//! Text of the file is overwritten in memory when it is dropped, as keys are.

use super::LinkKeys;
use rustix::rand::{GetRandomFlags, getrandom};
use serde::Deserialize;
use skyroost_protocol::{
    key::{KEY_LEN, Key},
    units::{DroneId, MAX_DRONES},
};
use std::{
    fmt::Write as _,
    fs::{self, File, OpenOptions},
    io::{self, Read, Write},
    os::unix::fs::{OpenOptionsExt, PermissionsExt},
    path::{Path, PathBuf},
};
use thiserror::Error;
use zeroize::{Zeroize, Zeroizing};

/// Version of the file.
const FORMAT: u32 = 1;
/// Nobody but the owner reads or writes it.
const MODE: u32 = 0o600;

/// Why keys cannot be read, made or written.
#[derive(Debug, Error)]
pub enum KeyFileError {
    /// The file cannot be opened, read or written.
    #[error("{}: {source}", .path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Others may read it.
    #[error("{}: mode {mode:03o} lets others read the keys, expected 600 (chmod 600)", .path.display())]
    Readable {
        /// Which file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// It is there already, and keys that drones may hold are not overwritten.
    #[error("{}: is there already, expected a new file", .path.display())]
    Exists {
        /// Which file.
        path: PathBuf,
    },
    /// It is no file of keys.
    #[error("{}: {what}", .path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// What is wrong. Keys are not repeated.
        what: String,
    },
    /// A key that a drone was given already.
    #[error(
        "{}: the key of drone {drone} was exported already, and with it the drone would count its boots from 1 again; \
         `skyroost keys renew` gives it another one",
        .path.display()
    )]
    Exported {
        /// Which file.
        path: PathBuf,
        /// The drone.
        drone: u16,
    },
    /// A drone that the file has no key for.
    #[error("{}: has no key for drone {drone}, expected one for each of the {drones} drone(s)", .path.display())]
    Missing {
        /// Which file.
        path: PathBuf,
        /// The first such drone.
        drone: u16,
        /// Drones of the mission.
        drones: usize,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    format: u32,
    control_boots: u16,
    #[serde(default)]
    control_key: Option<String>,
    #[serde(default, rename = "drone")]
    drones: Vec<Row>,
}

impl Drop for Table {
    fn drop(&mut self) {
        self.control_key.zeroize();
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    id: u16,
    key: String,
    #[serde(default)]
    exported: bool,
}

impl Drop for Row {
    fn drop(&mut self) {
        self.key.zeroize();
    }
}

/// Room for the text of a file but its drones, and for a drone of it: text that grows leaves copies behind.
const HEAD_ROOM: usize = 256;
const ROW_ROOM: usize = 256;

/// A drone's key.
#[derive(Clone, Debug)]
pub struct Kept {
    /// Whose.
    pub drone: DroneId,
    /// The key.
    pub key: Key,
    /// Whether it was given to the drone.
    pub exported: bool,
}

/// Root keys of a control center and its drones.
#[derive(Debug)]
pub struct KeyFile {
    path: PathBuf,
    control_boots: u16,
    /// What the control center makes fresh keys of, in each of its boots others; none in a file from before it had one.
    control_key: Option<Key>,
    /// By drone.
    keys: Vec<Kept>,
}

impl KeyFile {
    /// Fresh keys for drones 1 to `drones`, not yet written.
    ///
    /// # Errors
    /// [`KeyFileError::Io`] where the system has no chance to give.
    pub fn fresh(path: &Path, drones: u16) -> Result<Self, KeyFileError> {
        let keys =
            (1..=drones).map(|id| Ok(Kept { drone: DroneId(id), key: random(path)?, exported: false }));
        let keys = keys.collect::<Result<_, KeyFileError>>()?;
        Ok(Self { path: path.to_owned(), control_boots: 0, control_key: Some(random(path)?), keys })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`KeyFileError`].
    pub fn read(path: &Path) -> Result<Self, KeyFileError> {
        let io = |source| KeyFileError::Io { path: path.to_owned(), source };
        let mut file = File::open(path).map_err(io)?;
        let metadata = file.metadata().map_err(io)?;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(KeyFileError::Readable { path: path.to_owned(), mode });
        }
        let room = usize::try_from(metadata.len()).unwrap_or_default() + 1;
        let mut text = Zeroizing::new(String::with_capacity(room));
        file.read_to_string(&mut text).map_err(io)?;
        Self::parse(path, &text)
    }

    /// Reads the text of the file at `path`.
    ///
    /// # Errors
    /// [`KeyFileError::Format`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, KeyFileError> {
        let wrong = |what: String| KeyFileError::Format { path: path.to_owned(), what };
        // The parser's own words would show the line, and with it the key; and so would what it quotes.
        let table: Table = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let line = 1 + text.bytes().take(at).filter(|byte| *byte == b'\n').count();
            let what = error.message().split(['`', '"']).next().unwrap_or_default().trim_end();
            wrong(format!("line {line}: {what}, expected a file of `skyroost keys new`"))
        })?;
        if table.format != FORMAT {
            return Err(wrong(format!("format {}, expected {FORMAT}", table.format)));
        }
        let mut keys: Vec<Kept> = Vec::new();
        for Row { id, key, exported } in &table.drones {
            if !(1..=MAX_DRONES).contains(id) || keys.iter().any(|known| known.drone.0 == *id) {
                return Err(wrong(format!("drone {id}, expected each of 1 to {MAX_DRONES} once at most")));
            }
            let key = key_of(key).ok_or_else(|| {
                wrong(format!("the key of drone {id} is none, expected {} hexadecimal digits", 2 * KEY_LEN))
            })?;
            keys.push(Kept { drone: DroneId(*id), key, exported: *exported });
        }
        let digits = || wrong(format!("control_key is none, expected {} hexadecimal digits", 2 * KEY_LEN));
        let control_key =
            table.control_key.as_ref().map(|text| key_of(text).ok_or_else(digits)).transpose()?;
        Ok(Self { path: path.to_owned(), control_boots: table.control_boots, control_key, keys })
    }

    /// The drones and their keys.
    pub fn keys(&self) -> impl Iterator<Item = &Kept> {
        self.keys.iter()
    }

    /// The key of a drone, if there is one.
    #[must_use]
    pub fn key(&self, drone: DroneId) -> Option<&Key> {
        self.keys().find(|known| known.drone == drone).map(|known| &known.key)
    }

    /// How often a control center has started with these keys.
    #[must_use]
    pub fn control_boots(&self) -> u16 {
        self.control_boots
    }

    /// Gives a drone a fresh key, in the place of the one it had; not yet written.
    ///
    /// # Errors
    /// [`KeyFileError::Io`] where the system has no chance to give.
    pub fn renew(&mut self, drone: DroneId) -> Result<(), KeyFileError> {
        let key = random(&self.path)?;
        self.keys.retain(|known| known.drone != drone);
        self.keys.push(Kept { drone, key, exported: false });
        self.keys.sort_by_key(|known| known.drone);
        Ok(())
    }

    /// Writes to the new file `out` what gives a drone its key: once, since a drone that is given a key counts its boots from 1, and
    /// would seal other frames with the nonces that it had. That it was given is on disk before `out` is there; where `out`
    /// cannot be written, it was not given.
    ///
    /// # Errors
    /// [`KeyFileError`].
    pub fn export(
        &mut self,
        drone: DroneId,
        out: &Path,
        to_bytes: impl FnOnce(&Key) -> Zeroizing<Vec<u8>>,
    ) -> Result<(), KeyFileError> {
        let path = || self.path.clone();
        let Some(index) = self.keys.iter().position(|known| known.drone == drone) else {
            return Err(KeyFileError::Missing { path: path(), drone: drone.0, drones: 1 });
        };
        if self.keys[index].exported {
            return Err(KeyFileError::Exported { path: path(), drone: drone.0 });
        }
        let bytes = to_bytes(&self.keys[index].key);
        if out.exists() {
            return Err(KeyFileError::Exists { path: out.to_owned() });
        }
        self.keys[index].exported = true;
        self.replace()?;
        let written = write_new(out, &bytes);
        if written.is_err() {
            self.keys[index].exported = false;
            self.replace()?;
        }
        written
    }

    /// What seals the links of a mission of so many drones. A boot of the control center is spent, and on disk before this
    /// returns.
    ///
    /// # Errors
    /// [`KeyFileError`].
    pub fn open_links(&mut self, drones: usize) -> Result<LinkKeys, KeyFileError> {
        let path = || self.path.clone();
        let of_drone = |id: u16| {
            let key = self.key(DroneId(id)).cloned();
            key.ok_or_else(|| KeyFileError::Missing { path: path(), drone: id, drones })
        };
        let roots = (1..=drones as u16).map(of_drone).collect::<Result<_, _>>()?;
        let boots = self.control_boots.checked_add(1).filter(|boots| *boots < u16::MAX / 2);
        self.control_boots = boots.ok_or_else(|| KeyFileError::Format {
            path: path(),
            what: "has started as many control centers as it can, expected new keys".to_owned(),
        })?;
        let control_key = match self.control_key.take() {
            Some(key) => key,
            None => random(&self.path)?,
        };
        let links = LinkKeys::new(roots, self.control_boots, &control_key);
        self.control_key = Some(control_key);
        self.replace()?;
        Ok(links)
    }

    /// Writes a file that is not there yet.
    ///
    /// # Errors
    /// [`KeyFileError`].
    pub fn create(&self) -> Result<(), KeyFileError> {
        write_new(&self.path, self.text().as_bytes())
    }

    /// Writes the file anew, whole or not at all.
    ///
    /// # Errors
    /// [`KeyFileError::Io`].
    pub fn replace(&self) -> Result<(), KeyFileError> {
        let io = |source| KeyFileError::Io { path: self.path.clone(), source };
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let temporary = self.path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
        let written = write_new(&temporary, self.text().as_bytes())
            .and_then(|()| fs::rename(&temporary, &self.path).map_err(io));
        if written.is_err() {
            let _ = fs::remove_file(&temporary); // best effort: it may not be there
        }
        written
    }

    /// The file's text.
    ///
    /// # Panics
    /// Never: text takes what is written to it.
    #[must_use]
    pub fn text(&self) -> Zeroizing<String> {
        let mut text = Zeroizing::new(String::with_capacity(HEAD_ROOM + ROW_ROOM * self.keys.len()));
        self.write(&mut text).expect("text takes what is written to it");
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        writeln!(text, "# Whoever reads this file can command the drones. Made by `skyroost keys`.")?;
        writeln!(text, "format = {FORMAT}\ncontrol_boots = {}", self.control_boots)?;
        if let Some(key) = &self.control_key {
            write!(text, "control_key = \"")?;
            key.expose().iter().try_for_each(|byte| write!(text, "{byte:02x}"))?;
            writeln!(text, "\"")?;
        }
        for Kept { drone, key, exported } in &self.keys {
            write!(text, "\n[[drone]]\nid = {}\nkey = \"", drone.0)?;
            key.expose().iter().try_for_each(|byte| write!(text, "{byte:02x}"))?;
            writeln!(text, "\"")?;
            if *exported {
                writeln!(text, "exported = true")?;
            }
        }
        Ok(())
    }
}

/// Writes bytes for the owner's eyes to a file that is not there yet, and to disk.
///
/// # Errors
/// [`KeyFileError`].
pub fn write_new(path: &Path, bytes: &[u8]) -> Result<(), KeyFileError> {
    let mut options = OpenOptions::new();
    let written = options.write(true).create_new(true).mode(MODE).open(path).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => KeyFileError::Exists { path: path.to_owned() },
        _ => KeyFileError::Io { path: path.to_owned(), source },
    })
}

fn key_of(digits: &str) -> Option<Key> {
    let mut bytes = Zeroizing::new([0; KEY_LEN]);
    let pairs = digits.as_bytes().as_chunks::<2>();
    if digits.len() != 2 * KEY_LEN || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    for (byte, pair) in bytes.iter_mut().zip(pairs.0) {
        *byte = u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(Key::new(*bytes))
}

/// A key of the system's chance.
fn random(path: &Path) -> Result<Key, KeyFileError> {
    let mut bytes = Zeroizing::new([0; KEY_LEN]);
    let mut filled = 0;
    while filled < KEY_LEN {
        let more = getrandom(&mut bytes[filled..], GetRandomFlags::empty());
        filled += more.map_err(|error| KeyFileError::Io { path: path.to_owned(), source: error.into() })?;
    }
    Ok(Key::new(*bytes))
}
