"""The world: boards, layouts, reach, rules, instances and plans."""
