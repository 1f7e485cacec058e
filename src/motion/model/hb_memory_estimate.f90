!> Memory of a point, estimated from the sizes of its model alone, before any large allocation.
!> The estimate is the largest sum of arrays that exist at the same time. A point needs its balance (linear part,
!> samples) and, in addition, the most expensive of three: the tangent of the direct attempt, the fallback, the
!> error estimate with its own wider balance. Products with a tangent need a preconditioner, which becomes stronger for a
!> difficult problem; the strongest one is counted as fallback. Small arrays are counted with the next larger ones;
!> tests/cases/test_memory.py compares the estimate with the memory of runs.
module hb_memory_estimate
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: gib, wp
   use hb_options, only: options_t
   use hb_solver_types, only: solver_config_t
   use hb_system, only: system_t
   use hb_text, only: to_text
   implicit none
   private
   public :: amount, check_memory, estimate_memory, memory_estimate_t, memory_text, sizes_of, sizes_t

   !> The sizes on which the estimate depends; real numbers, because invalid inputs may exceed any integer.
   type :: sizes_t
      real(wp) :: n_dofs = 0, n_law_dofs = 0, n_coordinates = 0       !! of the structure; with laws; coordinates of laws
      real(wp) :: matrices = 0, factors = 0                           !! numbers of all matrices; of the factors of the interior
      real(wp) :: linear_bandwidth = 0, bandwidth = 0                 !! half: of the condensed stiffness, of a harmonic's tangent
      real(wp) :: n_harmonics = 0
      real(wp) :: n_kinds = 1                                         !! displacement, velocity, reaction
      real(wp) :: n_pairs = 0                                         !! coupled by laws
      real(wp) :: per_sample = 0                                      !! real numbers that laws store
      real(wp) :: answers_per_sample = 0                              !! of laws with memory, for a tangent
      real(wp) :: states = 0                                          !! coordinates times states, of laws with memory
      integer :: largest_dense = 0                                    !! unknowns up to which the tangent is a dense matrix
      real(wp) :: n_stored_dofs = 0
      integer, allocatable :: highest(:), samples(:)                  !! (n_tones)
      integer, allocatable :: stored_samples(:)                       !! of surfaces, size 0: none
      logical :: is_rigid = .false.                                   !! a law needs the reaction
      logical :: is_whole = .false.                                   !! a factor of the whole structure, no condensation
      logical :: has_error_estimate = .false.
      logical :: has_unknown_tones = .false.
      type(solver_config_t) :: solver
   end type sizes_t

   real(wp), parameter :: program_bytes = 50.0e6_wp                   ! MPI, HDF5 and the program itself, measured

   !> Bytes, by part.
   type :: memory_estimate_t
      real(wp) :: structure = 0                                       !! matrices and interior factors
      real(wp) :: linear = 0                                          !! loads, condensed stiffness, transfer to the interior
      real(wp) :: samples = 0                                         !! on the torus: motions, forces, spectra, derivatives
      real(wp) :: tangent = 0                                         !! of the direct attempt, with the vectors of the solver
      real(wp) :: fallback = 0   !! instead of the tangent, if the direct attempt fails or is difficult
      real(wp) :: error_estimate = 0                                     !! wider balance, in addition to the tangent
      real(wp) :: results = 0                                         !! of a point, surfaces with their balance
   contains
      procedure :: usual => memory_estimate_usual
      procedure :: worst => memory_estimate_worst
   end type memory_estimate_t

   interface

      !> Bytes that a point with these sizes needs.
      pure module function estimate_memory(s) result(bytes)
         type(sizes_t), intent(in) :: s
         type(memory_estimate_t) :: bytes
      end function estimate_memory

      !> The sizes of a model; laws from the first one with an error onwards, and a grid with one, do not count.
      !> Neighbours may need all tuples. Scans sparse matrices of the structure once.
      module function sizes_of(system, discretisation, options) result(self)
         type(system_t), intent(in) :: system
         type(discretisation_t), intent(in) :: discretisation
         type(options_t), intent(in) :: options
         type(sizes_t) :: self
      end function sizes_of

      !> Unknowns of a set of that many harmonics.
      pure real(wp) module function unknowns(s, n_harmonics)
         type(sizes_t), intent(in) :: s
         real(wp), intent(in) :: n_harmonics
      end function unknowns

      !> Entries of the table of products, see hb_transform.
      pure real(wp) module function table_size(highest)
         integer, intent(in) :: highest(:)
      end function table_size

      pure real(wp) module function volume(samples)
         integer, intent(in) :: samples(:)
      end function volume

   end interface

contains

   !> Bytes of a point whose direct attempt succeeds.
   pure real(wp) function memory_estimate_usual(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_usual = program_bytes + self%structure + self%linear + self%samples + self%results + &
                              max(self%tangent, self%error_estimate)
   end function memory_estimate_usual

   !> Bytes of a point that uses everything its settings permit.
   pure real(wp) function memory_estimate_worst(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_worst = max(self%usual(), program_bytes + self%structure + self%linear + self%samples + self%results + &
                                  self%fallback)
   end function memory_estimate_worst

   !> Fails for sizes that need more than `limit` bytes or overflow; the message names the largest parts and sizes
   !> that would fit.
   subroutine check_memory(s, limit, error)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit                                   !! bytes for this process
      type(error_t), allocatable, intent(out) :: error
      type(memory_estimate_t) :: bytes
      character(:), allocatable :: change

      if (max(unknowns(s, s%n_harmonics), table_size(s%highest)) > real(huge(1), wp)) then
         call fail(error, "there would be "//to_text(anint(unknowns(s, s%n_harmonics)))//" unknowns, more than can be counted; "// &
                   "lower the order of the harmonics")
         return
      else if (largest_row(s) > real(huge(1), wp)) then
         call fail(error, "a point would store "//to_text(anint(largest_row(s)))//" values of one kind, more than can be "// &
                   "counted; store fewer degrees of freedom or samples, or lower the order of the harmonics")
         return
      end if
      bytes = estimate_memory(s)
      if (bytes%worst() <= limit) return
      call find_what_fits(s, limit, change)
      call fail(error, "this point would need "//trim(amount(bytes%worst()))//" of memory, "//trim(amount(limit))// &
                " are available for each process: "//trim(memory_text(bytes))//". "//change)
   end subroutine check_memory

   !> Largest number of values that a point has in one dataset of the result file.
   pure real(wp) function largest_row(s)
      type(sizes_t), intent(in) :: s

      largest_row = 2*s%n_harmonics*max(s%n_stored_dofs, s%n_law_dofs)
      if (size(s%stored_samples) > 0) largest_row = max(largest_row, volume(s%stored_samples)*s%n_law_dofs)
   end function largest_row

   !> The important parts, the largest first: such as `tangent 3.1 GiB, samples 0.4 GiB`.
   pure function memory_text(bytes) result(text)
      type(memory_estimate_t), intent(in) :: bytes
      character(250) :: text
      character(14), parameter :: names(7) = [character(14) :: &
         "structure", "linear part", "samples", "tangent", "fallback", "error estimate", "results"]
      real(wp) :: parts(7)
      integer :: i, k

      parts = [bytes%structure, bytes%linear, bytes%samples, bytes%tangent, bytes%fallback, bytes%error_estimate, &
               bytes%results]
      text = ""
      do k = 1, size(parts)
         i = maxloc(parts, dim=1)
         if (parts(i) < 0.01_wp*bytes%worst() .and. k > 1) exit
         text = trim(text)//", "//trim(names(i))//" "//amount(parts(i))
         parts(i) = -1.0_wp
      end do
      text = text(3:)
   end function memory_text

   !> Finds changes after which the point fits: no fallback, or lower orders with harmonics and samples in proportion.
   subroutine find_what_fits(s, limit, text)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit
      character(:), allocatable, intent(out) :: text
      type(sizes_t) :: other
      real(wp) :: share(size(s%highest))

      text = ""
      other = s
      other%solver%fallback = .false.
      if (worst_of(other) <= limit) text = "no solver%fallback ("//trim(amount(worst_of(other)))//"); "
      other = s
      do while (worst_of(other) > limit .and. any(other%highest > 1))
         other%highest = max(min(s%highest, 1), int(0.95_wp*other%highest))
         share = (2*real(other%highest, wp) + 1)/(2*real(s%highest, wp) + 1)
         other%n_harmonics = max(1.0_wp, s%n_harmonics*product(share))
         other%samples = ceiling(share*s%samples)
      end do
      if (worst_of(other) <= limit) text = text//"order "//to_text(maxval(other%highest))//" instead of "// &
         to_text(maxval(s%highest))//" with at most "//to_text(maxval(other%samples))//" samples a tone ("// &
         trim(amount(worst_of(other)))//")"
      if (len(text) == 0) then
         text = "No lower order would fit; take a smaller structure or permit more memory (memory_limit)"
      else
         text = "What would fit: "//text
      end if
   end subroutine find_what_fits

   pure real(wp) function worst_of(s)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes

      bytes = estimate_memory(s)
      worst_of = bytes%worst()
   end function worst_of

   !> Bytes as text, such as 0.25 GiB or 12 MiB.
   pure function amount(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(14) :: text

      if (bytes >= 1.0e6_wp*gib) then
         write (text, "(es8.1, a)") bytes/gib, " GiB"
      else if (bytes >= 0.95_wp*gib) then
         write (text, "(f10.1, a)") bytes/gib, " GiB"
      else
         write (text, "(i10, a)") nint(bytes/gib*1024.0_wp), " MiB"
      end if
      text = adjustl(text)
   end function amount

end module hb_memory_estimate
