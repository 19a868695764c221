//! The number of files and connections that the program may have open.

/// Raises the program's limit to `needed` open files, as far as the system lets it: many systems
/// start programs with a limit of 1024 that they may raise themselves.
pub fn allow(needed: usize) {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let limit = getrlimit(Resource::Nofile);
        let needed = needed as u64;
        if limit.current.is_none_or(|current| current >= needed) {
            return;
        }
        let possible = limit.maximum.map_or(needed, |most| most.min(needed));
        let current = Some(possible);
        let raised = setrlimit(Resource::Nofile, Rlimit { current, ..limit });
        if raised.is_err() || possible < needed {
            tracing::warn!(
                "the system allows this program {possible} open files, and the configured number of \
                 viewers needs {needed}; raise the limit (ulimit -n, LimitNOFILE of the service), or \
                 lower `viewers` in [status]"
            );
        }
    }
    #[cfg(not(unix))]
    let _ = needed;
}
