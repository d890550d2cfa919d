// tests/tools/suite_test.cpp — the failure suite: every case's verdicts, and that a wrong claim earns a wrong verdict.
#include "tools/lab/suite.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/server/worlds.h"

namespace {

using tools::lab::Claim;
using tools::lab::ClaimResult;
using tools::lab::SuiteCase;
using tools::lab::Verdict;

SuiteCase named(const std::string& name) {
    const std::vector<SuiteCase> cases = tools::lab::suiteCases();
    const auto at = std::find_if(cases.begin(), cases.end(), [&](const SuiteCase& c) { return c.name == name; });
    CHECK(at != cases.end());
    return *at;
}

std::vector<ClaimResult> run(const SuiteCase& c) {
    auto results = tools::lab::runCase(tests::validatedDevice(), c);
    if (!results) throw std::runtime_error(results.error().what);
    tests::expectSilence();
    return results.value();
}

class FailureSuite : public testing::TestWithParam<std::string> {};

TEST_P(FailureSuite, FailsAndHoldsAsItMust) {
    const SuiteCase c = named(GetParam());
    const std::vector<ClaimResult> results = run(c);
    ASSERT_EQ(results.size(), c.claims.size());
    for (const ClaimResult& r : results) EXPECT_FALSE(tools::lab::wrong(r.verdict)) << tools::lab::suiteRows(c, {r});
}

std::vector<std::string> caseNames() {
    std::vector<std::string> names;
    for (const SuiteCase& c : tools::lab::suiteCases()) names.push_back(c.name);
    return names;
}

INSTANTIATE_TEST_SUITE_P(Lab, FailureSuite, testing::ValuesIn(caseNames()), [](const auto& param) {
    std::string name = param.param;
    for (char& letter : name)
        if (!std::isalnum(static_cast<unsigned char>(letter))) letter = '_';
    return name;
});

TEST(FailureSuiteVerdicts, TurnWrongWithTheirClaims) {
    SuiteCase c = named("turning");
    ASSERT_GT(c.claims.size(), 0u);
    // The same claims, upside down: who must fail is said to hold, and who holds to fail.
    for (Claim& claim : c.claims) {
        const bool fails = claim.kind == Claim::Kind::kFails;
        claim.kind = fails ? Claim::Kind::kHolds : Claim::Kind::kFails;
        claim.limit = fails ? 0 : 1e9;
        claim.than.reset();
    }
    const std::vector<ClaimResult> results = run(c);
    ASSERT_EQ(results.size(), c.claims.size());
    for (const ClaimResult& r : results) {
        EXPECT_EQ(r.verdict, r.claim.kind == Claim::Kind::kHolds ? Verdict::kDoesNotHold : Verdict::kFailsToFail);
        const std::string row = tools::lab::suiteRows(c, {r});
        EXPECT_NE(row.find(tools::lab::toString(r.verdict)), std::string::npos);
        EXPECT_NE(row.find("expected since " + r.claim.why), std::string::npos) << row;
    }
}

TEST(FailureSuiteVerdicts, NameTheCaseOfAnError) {
    SuiteCase c = named("turning");
    c.claims.front().who.method = "doughnaut";
    const auto results = tools::lab::runCase(tests::validatedDevice(), c);
    ASSERT_FALSE(results);
    EXPECT_EQ(results.error().code, world::ErrorCode::kUsage);
    EXPECT_NE(results.error().what.find("case turning"), std::string::npos) << results.error().what;
    EXPECT_NE(results.error().what.find("doughnut"), std::string::npos) << results.error().what;
}

TEST(Stage, GivesItsFilesBack) {
    tools::lab::Stage stage;
    stage.addGround({0, 0}, 64);
    stage.addBox({1, 2, 3}, {1, 8, 1}, "pole");
    std::string path;
    {
        const auto made = tools::lab::StageWorld::bake(stage);
        ASSERT_TRUE(made) << made.error().what;
        path = made.value().store().path();
        EXPECT_TRUE(std::filesystem::exists(path));
        EXPECT_TRUE(made.value().store().check().empty());
        EXPECT_EQ(made.value().store().names().value().size(), 1u);
    }
    EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(path).parent_path()));
    // The cube root of the three factors, as recordings of movers carry it.
    EXPECT_DOUBLE_EQ(stage.restOf("pole", 0).scale, 2);
}

}  // namespace
