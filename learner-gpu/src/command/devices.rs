//! `sinew devices`: what a search could run on.

use std::process::ExitCode;

use sinew_learn::{cpu, gpu};

use super::{Failure, print, table};

/// List what learning can run on: adapters with their drivers, and the CPU's SIMD width
#[derive(clap::Args)]
pub struct Arguments {}

/// Runs the command.
pub fn run(_: &Arguments) -> Result<ExitCode, Failure> {
    let mut rows = vec![["backend", "device", "driver"].map(str::to_owned).to_vec()];
    for adapter in gpu::adapters() {
        rows.push(vec![
            "gpu".to_owned(),
            adapter.to_string(),
            adapter.driver.clone(),
        ]);
    }
    rows.push(vec!["cpu".to_owned(), cpu::describe(), String::new()]);
    print(&table(&rows))?;
    Ok(ExitCode::SUCCESS)
}
