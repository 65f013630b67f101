"""The command lines of the programs: what stands here is loaded for --help, the work itself only when it is asked for."""
