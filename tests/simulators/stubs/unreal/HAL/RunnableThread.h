#pragma once
#include "HAL/Runnable.h"

enum EThreadPriority { TPri_TimeCritical };

class FRunnableThread
{
public:
    static FRunnableThread* Create(FRunnable*, const char*, int, EThreadPriority)
    {
        return nullptr;
    }
    void WaitForCompletion() {}
};
