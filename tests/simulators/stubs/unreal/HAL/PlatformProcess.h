#pragma once

struct FPlatformProcess
{
    static void YieldThread() {}
};
