#include "StepBlocksComponent.h"

#include "HAL/PlatformProcess.h"
#include "HAL/PlatformTime.h"
#include "HAL/RunnableThread.h"

void UStepBlocksComponent::BeginPlay()
{
    Super::BeginPlay();
    World = sb_create();
    if (!World || sb_abi_version() != SB_ABI_VERSION || sb_load(World, TCHAR_TO_UTF8(*Blocks)) < 1)
    {
        UE_LOG(LogTemp, Error, TEXT("StepBlocks: %s"), UTF8_TO_TCHAR(sb_message(World)));
        return;
    }
    if (ForceLimit >= 0.0)
    {
        sb_configure(World, SB_FORCE_LIMIT, ForceLimit);
    }
    sb_configure(World, SB_RISE, Rise);
    sb_choose(World, 0);
    bRunning = true;
    Thread = FRunnableThread::Create(this, TEXT("StepBlocks"), 0, TPri_TimeCritical);
}

uint32 UStepBlocksComponent::Run()
{
    double Before = FPlatformTime::Seconds(), Due = Before;
    double Hand[3] = {0.0, 0.0, 1.0}, Velocity[3] = {0.0, 0.0, 0.0};
    while (bRunning)
    {
        Due += 1.0 / Rate;
        while (bRunning && FPlatformTime::Seconds() < Due)
        {
            FPlatformProcess::YieldThread();
        }
        const double Now = FPlatformTime::Seconds();
        Due = Now - Due > 0.1 ? Now : Due;
        const int Next = Wanted.exchange(-1);
        if (Next >= 0)
        {
            sb_choose(World, Next);
        }
        if (Device)
        {
            Device->Read(Hand, Velocity);
        }
        sb_output Output;
        (bTooth ? sb_tick_tooth : sb_tick)(World, Hand, Velocity, Now - Before, &Output);
        Before = Now;
        if (Device)
        {
            Device->Write(Output.force);
        }
        FScopeLock Lock(&Gate);
        Shown = Output;
    }
    const double None[3] = {0.0, 0.0, 0.0};
    if (Device)
    {
        Device->Write(None);
    }
    return 0;
}

bool UStepBlocksComponent::Choose(const FString& Name)
{
    const int Found = sb_find(World, TCHAR_TO_UTF8(*Name));
    Wanted = Found;
    return Found >= 0;
}

sb_output UStepBlocksComponent::Last() const
{
    FScopeLock Lock(&Gate);
    return Shown;
}

FVector UStepBlocksComponent::Tip() const
{
    const sb_output Now = Last();
    return FVector(100.0 * Now.tip[0], -100.0 * Now.tip[1], 100.0 * Now.tip[2]);
}

void UStepBlocksComponent::EndPlay(const EEndPlayReason::Type Reason)
{
    bRunning = false;
    if (Thread)
    {
        Thread->WaitForCompletion();
        delete Thread;
        Thread = nullptr;
    }
    sb_destroy(World);
    World = nullptr;
    Super::EndPlay(Reason);
}
