//! Writes the shipped sample again: `cargo run -p sinew-learn --example make-sample`.
//!
//! Each file is written beside the old one and then takes its name, so that no file is ever half written.

use sinew_learn::{csv, sample};
use std::error::Error;
use std::fs;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample");
    fs::create_dir_all(&folder)?;
    for motion in sample::reaches()? {
        let file = folder.join(format!("{}.csv", motion.name()));
        let beside = file.with_extension("csv.part");
        let mut text = Vec::new();
        csv::write(&motion, &mut text)?;
        fs::write(&beside, text)?;
        fs::rename(&beside, &file)?;
        println!("{}", file.display());
    }
    Ok(())
}
