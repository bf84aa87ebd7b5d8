"""Study: a simulated follower flies formation on nothing but our estimates."""
