//! Puts the board's memory map where the linker looks for it.

use std::path::PathBuf;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let map = match env::var("CARGO_FEATURE_STM32F411") {
        Ok(_) => "memory/stm32f411.x",
        Err(_) => "memory/qemu.x",
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    fs::copy(map, out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed={map}");
    Ok(())
}
