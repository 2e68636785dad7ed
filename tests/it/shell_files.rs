//! Completions and man pages, as the archive of a release holds them.

#[path = "../../examples/shell_files.rs"]
#[allow(dead_code)]
mod shell_files;

#[test]
fn completions_and_man_pages_name_every_command() {
    let folder = tempfile::tempdir().unwrap();
    shell_files::write(folder.path()).unwrap();
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
