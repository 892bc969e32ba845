//! The command `mrvis`: one file per subcommand, on the public API of the other rooms.

pub mod fbem;
