"""Many runs: what is varied, the plan, the work, the store, executors, and the result of a study."""
