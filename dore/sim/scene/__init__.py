"""The ManiSkill task and its arms."""
