//! The `skyroost` command.

fn main() -> std::process::ExitCode {
    skyroost_host_sim::cli::main()
}
