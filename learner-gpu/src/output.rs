//! Files that are whole or not there: written beside their place, then renamed into it.

use std::io::Write;
use std::path::Path;

/// Puts `bytes` at `path`. What was there stays until the new file is complete.
///
/// # Errors
/// What the system says.
pub fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    // A link's file is replaced, not the link; what is no file (a pipe, a device) is written to.
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let path = target.as_path();
    if std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return std::fs::OpenOptions::new()
            .write(true)
            .open(path)?
            .write_all(bytes);
    }
    let mut beside = beside(path)?;
    beside.write_all(bytes)?;
    beside.as_file().sync_all()?;
    // A temporary file is private to its owner; what it becomes is an ordinary file.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(path).map_or(0o644, |there| there.permissions().mode());
        beside
            .as_file()
            .set_permissions(std::fs::Permissions::from_mode(mode))?;
    }
    beside.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Whether [`replace`] has a place to put a file: asked before the work that it is to hold.
///
/// # Errors
/// A folder there, or none that a file can be put in.
pub fn can_replace(path: &Path) -> std::io::Result<()> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    match std::fs::metadata(&path) {
        Ok(there) if there.is_dir() => Err(std::io::Error::new(
            std::io::ErrorKind::IsADirectory,
            "there is a folder, expected a file or nothing",
        )),
        Ok(there) if !there.is_file() => Ok(()),
        _ => beside(&path).map(|_| ()),
    }
}

/// An empty file beside a place, which goes away again unless it is put there.
///
/// # Errors
/// What the system says: of the place, not of a name that nobody asked for.
fn beside(path: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    tempfile::NamedTempFile::new_in(folder(path)).map_err(|error| {
        let words = error.to_string();
        let words = words.split(" at path ").next().unwrap_or_default();
        std::io::Error::new(error.kind(), words)
    })
}

/// The folder that a file is in.
fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::replace;

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("synergies.json");
        replace(&path, b"old").unwrap();
        replace(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_a_device_a_device() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        replace(&link, b"new").unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        replace(std::path::Path::new("/dev/null"), b"new").unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }

    #[test]
    fn where_it_cannot_be_written_the_old_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("missing").join("synergies.json");
        assert!(replace(&path, b"new").is_err());
    }
}
