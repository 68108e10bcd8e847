//! Which recordings to learn from: the files and folders a person names, or the sample that ships with the project.

use std::path::{Path, PathBuf};

use crate::csv::{self, CsvError};
use crate::motion::Motion;
use crate::sample;

/// Where the shipped sample lies in the project.
const SAMPLE: &str = "learner-gpu/sample";

/// A recording and the name it goes by in files.
#[derive(Clone, Debug)]
pub struct Recording {
    /// The path as it was given; of the sample, its path in the project.
    pub file: String,
    /// What is in it.
    pub motion: Motion,
}

/// Why recordings cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingsError {
    /// A file is not a recording.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// A folder cannot be listed.
    #[error("{path}: {error}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// A folder has no recordings in it.
    #[error("{path}: no recording (.csv) in this folder")]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// Not to be found anywhere.
    #[error(
        "the recording {file} is not there (looked in this folder, in {beside}, and in the shipped sample)"
    )]
    Missing {
        /// The recording.
        file: String,
        /// The folder of the file that names it.
        beside: String,
    },
}

/// The sample that ships with the project: made, not recorded.
///
/// # Errors
/// None, unless the project's own files are broken.
pub fn shipped() -> Result<Vec<Recording>, RecordingsError> {
    let named = |motion: Motion| Recording {
        file: format!("{SAMPLE}/{}.csv", motion.name()),
        motion,
    };
    Ok(sample::shipped()?.into_iter().map(named).collect())
}

/// Reads the files named, and every `.csv` in the folders named, in the order of their names.
///
/// # Errors
/// A file that cannot be read or is no recording, or a folder without any.
pub fn read(paths: &[PathBuf]) -> Result<Vec<Recording>, RecordingsError> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let folder = |error| RecordingsError::Folder {
            path: path.clone(),
            error,
        };
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(path).map_err(folder)? {
            let file = entry.map_err(folder)?.path();
            if file
                .extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
            {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            return Err(RecordingsError::Empty { path: path.clone() });
        }
        inside.sort();
        files.extend(inside);
    }
    let one = |file: &PathBuf| {
        Ok(Recording {
            file: file.display().to_string(),
            motion: csv::read(file)?,
        })
    };
    files.iter().map(one).collect()
}

/// The recording that a file of synergies names: by its path from here, from the folder of that file or the one above
/// (where `sinew learn --out DIR` ran), then in the shipped sample.
///
/// # Errors
/// It is nowhere, or is no recording.
pub fn find(file: &str, beside: &Path) -> Result<Recording, RecordingsError> {
    let places = [
        PathBuf::from(file),
        beside.join(file),
        beside.join("..").join(file),
    ];
    if let Some(path) = places.iter().find(|path| path.is_file()) {
        return Ok(Recording {
            file: file.to_owned(),
            motion: csv::read(path)?,
        });
    }
    let missing = || RecordingsError::Missing {
        file: file.to_owned(),
        beside: beside.display().to_string(),
    };
    shipped()?
        .into_iter()
        .find(|recording| recording.file == file)
        .ok_or_else(missing)
}
