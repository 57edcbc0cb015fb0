//! What a board in flight asks of the tasks in the [`shell`](super::shell).

use super::shell::{Shell, Stopwatch};
use crate::config::AgentConfig;
use crate::io::{Inputs, Outputs};
use skyroost_protocol::{key::Key, units::TimePs};

impl Shell {
    /// Be the drone of the configuration and the root key that `born` gives, and forget what was before.
    ///
    /// # Errors
    /// What `born` says; nothing is forgotten then.
    pub async fn begin<E>(
        &self,
        born: impl FnOnce() -> Result<(AgentConfig, Option<Key>), E>,
    ) -> Result<(), E> {
        let mut core = self.core.lock().await;
        let (config, key) = born()?;
        core.begin(config, key);
        Ok(())
    }

    /// Does the step at `now` for `board`: `sense` adds to the radio's frames what else was sensed, `act` sees
    /// to what is to be done. Returns what the step cost.
    ///
    /// Waits at most for a link that is putting a few bytes in.
    pub async fn fly<B>(
        &self,
        now: TimePs,
        stopwatch: &impl Stopwatch,
        board: &mut B,
        sense: impl FnOnce(&mut B, &mut Inputs),
        act: impl FnOnce(&mut B, &Outputs),
    ) -> u32 {
        let mut core = self.core.lock().await;
        sense(board, core.inputs);
        let cost = core.step(now, stopwatch);
        act(board, core.outputs);
        cost
    }
}
