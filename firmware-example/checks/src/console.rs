//! Printing and leaving, on a host and in QEMU.

/// Prints a line: through semihosting in QEMU.
#[macro_export]
macro_rules! say {
    ($($part:tt)*) => {{
        #[cfg(target_os = "none")]
        cortex_m_semihosting::hprintln!($($part)*);
        #[cfg(not(target_os = "none"))]
        println!($($part)*);
    }};
}

/// The program's entry point, on a host and in QEMU: a function that says whether all went well.
#[macro_export]
macro_rules! entry {
    ($run:path) => {
        #[cfg(target_os = "none")]
        #[cortex_m_rt::entry]
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
    use cortex_m_semihosting::debug;
    debug::exit(if well {
        debug::EXIT_SUCCESS
    } else {
        debug::EXIT_FAILURE
    });
    loop {
        cortex_m::asm::wfi();
    }
}
