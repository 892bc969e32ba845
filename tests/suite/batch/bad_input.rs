//! What changes or is wrong outside the job file: clear, early, and nothing is overwritten.

use super::{COUNT, JOBS, assert_same_files, batch, journal, prepared, results};
use crate::run::{Outcome, Scratch, wait_until};
use mrvis::internals::scene::generate::Spec;
use serde_json::Value;
use std::process::Command;

/// Two jobs, of which the second waits for the first; between them `change` happens.
fn with_change(change: impl FnOnce(&Scratch)) -> (Scratch, Outcome) {
    let scratch = Scratch::new();
    scratch.forest(6, 300);
    scratch.generate(&Spec::new("cornell"));
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = 'first'\ncommand = 'solve'\nscene = 'forest.obj'\noptions = { audit = 0, local-rays = 0, output = 'none' }\n\
         [[job]]\nname = 'second'\ncommand = 'info'\nscene = 'cornell.obj'\nafter = 'first'\n",
    );
    let child = scratch.started("batch jobs.toml --out o --log log.jsonl");
    let log = || std::fs::read_to_string(scratch.path("log.jsonl")).unwrap_or_default();
    wait_until(60, "the first job does not start", || log().contains("started"));
    change(&scratch);
    let ended = Outcome::at_end(child).exits(2);
    assert!(scratch.path("o/first/solution.json").exists() && !scratch.path("o/second").exists());
    (scratch, ended)
}

#[test]
fn a_scene_that_changes_meanwhile_fails_its_job() {
    let (scratch, ended) = with_change(|scratch| {
        let text = scratch.text("cornell.obj");
        scratch.write("cornell.obj", text + "# changed\n");
    });
    let want = "cornell.obj: was changed while the batch ran; run the batch again";
    ended.warns(want);
    // The cure that the message names.
    batch(&scratch, &["--out", "o"]).exits(0);
}

#[test]
fn a_scene_that_vanishes_meanwhile_fails_its_job() {
    let (scratch, ended) =
        with_change(|scratch| std::fs::remove_file(scratch.path("cornell.obj")).expect("removed"));
    ended.warns("failed second: cornell.obj: No such file");
    batch(&scratch, &["--out", "o"]).warns("the scene `cornell.obj` cannot be read");
}

#[test]
fn folders_without_rights_and_foreign_journals_are_refused() {
    let scratch = prepared();
    // Nobody may write there, not even root.
    let refused = batch(&scratch, &["--out", "/proc/mrvis"]).exits(2);
    assert!(refused.stderr.starts_with("mrvis: /proc/mrvis"), "{}", refused.stderr);

    batch(&scratch, &["--out", "o", "--only", "reference"]).exits(0);
    let path = scratch.path("o/.mrvis-batch/journal.jsonl");
    let line = std::fs::read_to_string(&path).expect("a journal");
    for (text, want) in [
        (
            line.replace("\"version\":2", "\"version\":3"),
            "journal.jsonl:1: is of version 3, this program writes 2",
        ),
        (line.replace("{\"version\"", "{\"ver"), "journal.jsonl:1: is"),
    ] {
        std::fs::write(&path, &text).expect("written");
        batch(&scratch, &["--out", "o"]).exits(2).warns(want);
        assert_eq!(std::fs::read_to_string(&path).expect("a journal"), text, "nothing is overwritten");
    }
}

/// When no more can be written the batch stops with what is done, and goes on when there is room: it makes what an undisturbed run makes,
/// and nothing that was done runs again. The disk is a small tmpfs that grows afterwards, or where this is forbidden a limit of the size
/// of files.
#[test]
fn a_full_disk_stops_the_batch_until_there_is_room() {
    let scratch = prepared();
    scratch.write("jobs.toml", JOBS.replace("output = ['none']", "output = ['vtu', 'glb']"));
    let run = |shell: &[&str], fill: &str, make_room: &str| {
        let script = format!(
            "{fill}; \"$0\" batch jobs.toml --out full > first 2>&1; echo $? > code; cp -r full stopped; \
             {make_room} && \"$0\" batch jobs.toml --out full > second 2>&1; cp -r full kept"
        );
        let mut command = Command::new(shell[0]);
        command.args(&shell[1..]).args(["-c", &script, env!("CARGO_BIN_EXE_mrvis")]);
        command.current_dir(scratch.path(".")).env("XDG_CACHE_HOME", scratch.path("cache"));
        command.output().is_ok_and(|ran| ran.status.success())
    };
    let mounted = |shell: &[&str]| {
        let fill = "mkdir -p full && mount -t tmpfs -o size=96k tmpfs full || exit 77";
        run(shell, fill, "mount -o remount,size=64m full")
    };
    // Root needs no user namespace, which some systems forbid. Without the trap the signal of the limit would end the program; a block of
    // bash has 1 KB.
    let ran = mounted(&["unshare", "--map-root-user", "--mount", "bash"])
        || mounted(&["unshare", "--mount", "bash"])
        || run(&["bash"], "trap '' XFSZ; ulimit -S -f 8", "ulimit -S -f unlimited");
    assert!(ran, "no shell could fill a disk");
    let text = |name: &str| scratch.text(name);
    let done = |out: &str| -> Vec<Value> {
        journal(&scratch.path(out)).into_iter().filter(|line| line["status"] == "done").collect()
    };
    assert_eq!(text("code").trim(), "2", "{}", text("first"));
    let first = text("first");
    assert!(first.contains("make room and run the same command again"), "{first}");
    // Not every job fails in turn: only those that ran at the same time do.
    assert!(first.matches("failed ").count() <= 4, "{first}");
    let before = done("stopped");
    assert!(before.len() < COUNT, "{first}");
    assert_eq!(journal(&scratch.path("stopped")).len(), before.len(), "jobs without room count as not run");
    assert!(text("second").contains(&format!("{} done before", before.len())), "{}", text("second"));
    let after = done("kept");
    assert_eq!((after.len(), &after[..before.len()]), (COUNT, &before[..]));
    batch(&scratch, &["--out", "undisturbed"]).exits(0);
    assert_same_files(&results(&scratch.path("kept")), &results(&scratch.path("undisturbed")));
}
