//! Writes what a shell knows of the command line: completions for bash, zsh and fish, and a man page for each command, where a
//! prefix such as `/usr/local` has them.
//!
//! `cargo run --example shell_files -- PREFIX`; `scripts/build-archive` calls it.

use clap_complete::{Shell, generate_to};
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    write(&std::env::args_os().nth(1).map_or_else(|| "target/shell".into(), PathBuf::from))
}

/// Writes all files below a prefix.
pub fn write(prefix: &Path) -> std::io::Result<()> {
    let completions = [
        (Shell::Bash, "share/bash-completion/completions"),
        (Shell::Zsh, "share/zsh/site-functions"),
        (Shell::Fish, "share/fish/vendor_completions.d"),
    ];
    for (shell, folder) in completions {
        let folder = prefix.join(folder);
        std::fs::create_dir_all(&folder)?;
        let written = generate_to(shell, &mut satgs::cli::program(), "satgs", &folder)?;
        if shell == Shell::Bash {
            // bash-completion finds the file by the name of the program alone.
            std::fs::rename(written, folder.join("satgs"))?;
        }
    }
    let pages = prefix.join("share/man/man1");
    std::fs::create_dir_all(&pages)?;
    clap_mangen::generate_to(satgs::cli::program().disable_help_subcommand(true), pages)
}
