//! The file that keeps the root keys: for its owner's eyes only, and written whole or not at all.
//!
//! TOML: `format = 1`, `control_boots` (how often a control center has started with these keys), and one `[[drone]]` with `id` and
//! `key` (64 hexadecimal digits) for each drone.

use super::LinkKeys;
use rustix::rand::{GetRandomFlags, getrandom};
use serde::{Deserialize, Serialize};
use skyroost_protocol::{
    key::{KEY_LEN, Key},
    units::{DroneId, MAX_DRONES},
};
use std::{
    fs::{self, File, OpenOptions},
    io::{self, Write},
    os::unix::fs::{OpenOptionsExt, PermissionsExt},
    path::{Path, PathBuf},
};
use thiserror::Error;

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

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    format: u32,
    control_boots: u16,
    #[serde(default, rename = "drone")]
    drones: Vec<Row>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    id: u16,
    key: String,
}

/// Root keys of a control center and its drones.
#[derive(Debug)]
pub struct KeyFile {
    path: PathBuf,
    control_boots: u16,
    /// By drone.
    keys: Vec<(DroneId, Key)>,
}

impl KeyFile {
    /// Fresh keys for drones 1 to `drones`, not yet written.
    ///
    /// # Errors
    /// [`KeyFileError::Io`] where the system has no chance to give.
    pub fn fresh(path: &Path, drones: u16) -> Result<Self, KeyFileError> {
        let keys = (1..=drones).map(|id| Ok((DroneId(id), random(path)?)));
        Ok(Self { path: path.to_owned(), control_boots: 0, keys: keys.collect::<Result<_, KeyFileError>>()? })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`KeyFileError`].
    pub fn read(path: &Path) -> Result<Self, KeyFileError> {
        let io = |source| KeyFileError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(io)?;
        let mode = file.metadata().map_err(io)?.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(KeyFileError::Readable { path: path.to_owned(), mode });
        }
        let text = io::read_to_string(file).map_err(io)?;
        let wrong = |what: String| KeyFileError::Format { path: path.to_owned(), what };
        // The parser's own words would show the line, and with it the key.
        let table: Table = toml::from_str(&text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let line = 1 + text.bytes().take(at).filter(|byte| *byte == b'\n').count();
            wrong(format!("line {line}: {}, expected a file of `skyroost keys new`", error.message()))
        })?;
        if table.format != FORMAT {
            return Err(wrong(format!("format {}, expected {FORMAT}", table.format)));
        }
        let mut keys: Vec<(DroneId, Key)> = Vec::new();
        for Row { id, key } in &table.drones {
            if !(1..=MAX_DRONES).contains(id) || keys.iter().any(|(known, _)| known.0 == *id) {
                return Err(wrong(format!("drone {id}, expected each of 1 to {MAX_DRONES} once at most")));
            }
            let key = key_of(key).ok_or_else(|| {
                wrong(format!("the key of drone {id} is none, expected {} hexadecimal digits", 2 * KEY_LEN))
            })?;
            keys.push((DroneId(*id), key));
        }
        Ok(Self { path: path.to_owned(), control_boots: table.control_boots, keys })
    }

    /// The drones and their keys.
    pub fn keys(&self) -> impl Iterator<Item = (DroneId, &Key)> {
        self.keys.iter().map(|(drone, key)| (*drone, key))
    }

    /// The key of a drone, if there is one.
    #[must_use]
    pub fn key(&self, drone: DroneId) -> Option<&Key> {
        self.keys().find(|(known, _)| *known == drone).map(|(_, key)| key)
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
        self.keys.retain(|(known, _)| *known != drone);
        self.keys.push((drone, key));
        self.keys.sort_by_key(|(drone, _)| *drone);
        Ok(())
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
        self.replace()?;
        Ok(LinkKeys::new(roots, self.control_boots, &random(&self.path)?))
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

    fn text(&self) -> String {
        let row = |(drone, key): &(DroneId, Key)| Row {
            id: drone.0,
            key: key.expose().iter().map(|byte| format!("{byte:02x}")).collect(),
        };
        let table = Table {
            format: FORMAT,
            control_boots: self.control_boots,
            drones: self.keys.iter().map(row).collect(),
        };
        let table = toml::to_string(&table).expect("numbers and text are TOML");
        format!("# Whoever reads this file can command the drones. Made by `skyroost keys`.\n{table}")
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
    let mut bytes = [0; KEY_LEN];
    let pairs = digits.as_bytes().as_chunks::<2>();
    if digits.len() != 2 * KEY_LEN || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    for (byte, pair) in bytes.iter_mut().zip(pairs.0) {
        *byte = u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(Key::new(bytes))
}

/// A key of the system's chance.
fn random(path: &Path) -> Result<Key, KeyFileError> {
    let mut bytes = [0; KEY_LEN];
    let mut filled = 0;
    while filled < KEY_LEN {
        let more = getrandom(&mut bytes[filled..], GetRandomFlags::empty());
        filled += more.map_err(|error| KeyFileError::Io { path: path.to_owned(), source: error.into() })?;
    }
    Ok(Key::new(bytes))
}
