"""The law and the loop of `HybridController` and followers, until the engine has theirs."""
