//! What a board in flight asks of the tasks in the [`shell`](super::shell).

use super::shell::{Shell, Stopwatch};
use crate::agent::FlightAgent;
use crate::config::AgentConfig;
use crate::io::{Inputs, Outputs};
use skyroost_protocol::units::TimePs;

impl Shell {
    /// Be the drone of this configuration, and forget what was before.
    pub async fn begin(&self, config: AgentConfig) {
        self.core.lock().await.begin(config);
    }

    /// Does the step at `now`: `sense` adds to the radio's frames what else was sensed, `act` sees to what
    /// is to be done. Returns what the step cost.
    ///
    /// Waits at most for a link that is putting a few bytes in.
    pub async fn fly(
        &self,
        now: TimePs,
        stopwatch: &impl Stopwatch,
        sense: impl FnOnce(&mut Inputs),
        act: impl FnOnce(&FlightAgent, &Outputs),
    ) -> u32 {
        let mut core = self.core.lock().await;
        sense(&mut core.inputs);
        let cost = core.step(now, stopwatch);
        act(&core.agent, &core.outputs);
        cost
    }
}
