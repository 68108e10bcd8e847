//! Prints a line for every plan and every motion: run on a microcontroller and on a host, the lines are the same.
#![cfg_attr(target_os = "none", no_std, no_main)]

use sinew_checks::motions::{REACHES, plans, run};
use sinew_checks::say;

sinew_checks::entry!(all);

/// How many of the reaches: a slow processor is spared some (`SINEW_REACHES` at build time).
fn count() -> usize {
    option_env!("SINEW_REACHES")
        .and_then(|n| n.parse().ok())
        .unwrap_or(usize::MAX)
}

fn all() -> bool {
    // First, so that with fewer reaches the lines are still the first of all.
    let planned = plans(|name, hash| say!("{} map: {:016x}", name, hash));
    planned.is_ok()
        && REACHES.iter().take(count()).all(|reach| {
            run(reach, |stepper, model, task, hash| {
                say!(
                    "{} {} {} {} {:016x}",
                    reach.name,
                    stepper,
                    model,
                    task,
                    hash
                );
            })
            .is_ok()
        })
}
