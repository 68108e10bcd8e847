//! Printing and leaving, on a host and in QEMU.

#[cfg(all(target_os = "none", target_arch = "arm"))]
pub use {cortex_m_rt as start, cortex_m_semihosting as semihosting};
// For its critical section, which the linker has to find.
#[cfg(target_arch = "riscv32")]
use riscv as _;
#[cfg(target_arch = "riscv32")]
pub use {riscv_rt as start, riscv_semihosting as semihosting};

/// Prints a line: through semihosting in QEMU.
#[macro_export]
macro_rules! say {
    ($($part:tt)*) => {{
        #[cfg(target_os = "none")]
        $crate::console::semihosting::hprintln!($($part)*);
        #[cfg(not(target_os = "none"))]
        println!($($part)*);
    }};
}

/// The program's entry point, on a host and in QEMU: a function that says whether all went well.
#[macro_export]
macro_rules! entry {
    ($run:path) => {
        #[cfg(target_os = "none")]
        #[$crate::console::start::entry]
        fn main() -> ! {
            $crate::console::leave($run())
        }

        #[cfg(target_os = "none")]
        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
            $crate::say!("panic: {}", info.message());
            $crate::console::leave(false)
        }

        #[cfg(not(target_os = "none"))]
        fn main() -> std::process::ExitCode {
            if $run() {
                std::process::ExitCode::SUCCESS
            } else {
                std::process::ExitCode::FAILURE
            }
        }
    };
}

/// Ends QEMU.
#[cfg(target_os = "none")]
pub fn leave(well: bool) -> ! {
    use semihosting::debug;
    debug::exit(if well {
        debug::EXIT_SUCCESS
    } else {
        debug::EXIT_FAILURE
    });
    loop {
        core::hint::spin_loop();
    }
}
