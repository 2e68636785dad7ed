//! `satgs-shell-files PREFIX` writes completions for bash, zsh and fish, and a man page for each command, where a prefix such as
//! `/usr/local` has them. `scripts/build-archive` calls it.

use clap_complete::{Shell, generate_to};
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    write(&std::env::args_os().nth(1).map_or_else(|| "target/shell".into(), PathBuf::from))
}

/// Writes all files below a prefix.
fn write(prefix: &Path) -> std::io::Result<()> {
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn completions_and_man_pages_name_every_command() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path()).unwrap();
        let share = folder.path().join("share");
        let read = |path: &str| std::fs::read_to_string(share.join(path)).unwrap();
        let shells = [
            read("bash-completion/completions/satgs"),
            read("zsh/site-functions/_satgs"),
            read("fish/vendor_completions.d/satgs.fish"),
        ];
        let overview = read("man/man1/satgs.1");
        let program = satgs::cli::program();
        let commands: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
        assert!(commands.contains(&"run") && commands.len() >= 20, "{commands:?}");
        for command in commands {
            for text in &shells {
                assert!(text.contains(command), "no completion of `{command}`");
            }
            // The formatter of man pages reads a plain hyphen as a minus.
            assert!(overview.contains(&command.replace('-', "\\-")), "satgs.1 does not name `{command}`");
            assert!(read(&format!("man/man1/satgs-{command}.1")).contains("SYNOPSIS"), "{command}");
        }
    }
}
