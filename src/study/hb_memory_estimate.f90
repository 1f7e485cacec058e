!> How much memory a point takes, from the sizes of its scene alone, before anything large is allocated.
!>
!> Counted is what lives at the same time in the worst moment, array by array as hb_balance, hb_law_set, the solvers and
!> hb_certificate allocate it. A point first stands in its balance (linear part, samples); on top of that comes the
!> costliest of three: the tangent of the direct attempt, the rescue, the certificate with its own wider balance.
module hb_memory_estimate
   use hb_certificate, only: wider_orders, wider_samples
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_memory_tangent, only: width
   use hb_solver_types, only: method, solver_config_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   use hb_torus, only: torus_t
   implicit none
   private
   public :: amount, check_memory, estimate_memory, gib, memory_estimate_t, memory_text, new_sizes, sizes_t

   real(wp), parameter :: gib = 1024.0_wp**3
   real(wp), parameter :: of_program = 50.0e6_wp                      ! MPI, HDF5 and the program itself, measured
   real(wp), parameter :: real_bytes = 8.0_wp, complex_bytes = 16.0_wp, integer_bytes = 4.0_wp
   real(wp), parameter :: copies_kept = 9.0_wp                        ! of a matrix: in the study, and while a point is read

   !> What the estimate depends on; real numbers, because hostile ones are beyond any integer.
   type :: sizes_t
      real(wp) :: n_dofs = 0, n_law_dofs = 0                          !! of the structure; on which laws act
      real(wp) :: n_entries = 0, bandwidth = 0                        !! of its matrices
      real(wp) :: n_harmonics = 0
      real(wp) :: n_pairs = 0                                         !! coupled by laws
      real(wp) :: laws_per_sample = 0, derivatives_per_sample = 0     !! real numbers that laws keep for themselves
      real(wp) :: answers_per_sample = 0                              !! of laws with memory, for a tangent
      real(wp) :: states = 0                                          !! coordinates times states, of laws with memory
      logical :: needs_velocity = .false., needs_reaction = .false., has_memory = .false.
      real(wp) :: n_stored_dofs = 0
      integer, allocatable :: highest(:), samples(:)                  !! (n_tones)
      integer, allocatable :: stored_samples(:)                       !! of surfaces, size 0: none
      logical :: has_certificate = .false.
      type(solver_config_t) :: solver
   end type sizes_t

   !> Bytes, by part.
   type :: memory_estimate_t
      real(wp) :: structure = 0                                       !! matrices and interior factors
      real(wp) :: linear = 0                                          !! loads, condensed stiffness, transfer to the interior
      real(wp) :: samples = 0                                         !! on the torus: motions, forces, spectra, derivatives
      real(wp) :: tangent = 0                                         !! of the direct attempt, with the vectors of the solver
      real(wp) :: rescue = 0                                          !! instead of the tangent, when the direct attempt fails
      real(wp) :: certificate = 0                                     !! wider balance, beside the tangent
      real(wp) :: results = 0                                         !! of a point, surfaces with their balance
   contains
      procedure :: usual => memory_estimate_usual
      procedure :: worst => memory_estimate_worst
   end type memory_estimate_t

contains

   !> Takes the sizes from the parts of a scene; scans the matrices of the structure once.
   subroutine new_sizes(self, structure, harmonics, torus, laws, n_law_dofs, n_stored_dofs, stored_samples, solver, has_certificate)
      type(sizes_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: n_law_dofs, n_stored_dofs
      integer, intent(in) :: stored_samples(:)                        !! of surfaces, size 0: none
      type(solver_config_t), intent(in) :: solver
      logical, intent(in) :: has_certificate
      integer :: i

      self%n_dofs = structure%n_dofs
      self%n_law_dofs = n_law_dofs
      self%n_harmonics = harmonics%n_harmonics
      self%highest = harmonics%highest
      self%samples = torus%n_samples
      self%n_stored_dofs = n_stored_dofs
      self%stored_samples = stored_samples
      self%solver = solver
      self%has_certificate = has_certificate .and. size(laws) > 0
      call scan_structure(self, structure)
      do i = 1, size(laws)
         call add_law(self, laws, i)
      end do
      self%n_pairs = min(self%n_pairs, self%n_law_dofs**2)
   end subroutine new_sizes

   !> Counts entries and bandwidth.
   subroutine scan_structure(self, structure)
      type(sizes_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      integer :: first, i, j, last

      do j = 1, structure%n_dofs
         first = j
         last = j
         do i = 1, structure%n_dofs
            if (max(abs(structure%mass(i, j)), abs(structure%damping(i, j)), abs(structure%stiffness(i, j))) <= 0.0_wp) cycle
            self%n_entries = self%n_entries + 1.0_wp
            first = min(first, i)
            last = max(last, i)
         end do
         self%bandwidth = max(self%bandwidth, real(max(j - first, last - j), wp))
      end do
   end subroutine scan_structure

   !> Adds what law i keeps for itself, see hb_law_slot, hb_slider_memory and hb_memory_tangent.
   subroutine add_law(self, laws, i)
      type(sizes_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: i
      real(wp) :: c, d, p, v
      integer :: k

      associate (law => laws(i)%law)
         c = size(law%shape, 2)
         d = size(law%shape, 1)
         v = merge(c, 0.0_wp, law%needs_velocity)
         p = merge(c, 0.0_wp, law%is_multiplier)
         self%needs_velocity = self%needs_velocity .or. law%needs_velocity
         self%needs_reaction = self%needs_reaction .or. law%is_multiplier
         self%laws_per_sample = self%laws_per_sample + 2*c + v + p
         select type (law)
         class is (hysteretic_law_t)
            associate (n => real(law%n_states, wp))
               self%has_memory = .true.
               self%laws_per_sample = self%laws_per_sample + n_path_parts*c + n
               self%derivatives_per_sample = self%derivatives_per_sample + n*n + n*c*n_path_parts
               self%answers_per_sample = self%answers_per_sample + c*c + c*n + 2*width*c
               self%states = self%states + c*n
            end associate
         class default
            self%derivatives_per_sample = self%derivatives_per_sample + c*(c + v + p)
            self%n_pairs = self%n_pairs + d*d
            if (.not. law%is_multiplier) return
            do k = 1, size(laws)                                       ! it answers to the forces of its neighbours
               if (k /= i .and. any_shared(law%dofs, laws(k)%law%dofs)) self%n_pairs = self%n_pairs + d*size(laws(k)%law%dofs)
            end do
         end select
      end associate
   end subroutine add_law

   pure logical function any_shared(a, b)
      integer, intent(in) :: a(:), b(:)
      integer :: i

      any_shared = .false.
      do i = 1, size(a)
         any_shared = any_shared .or. any(b == a(i))
      end do
   end function any_shared

   !> Bytes that a point with these sizes takes.
   pure function estimate_memory(s) result(bytes)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes
      real(wp) :: n, n_wide
      integer, allocatable :: orders(:), samples(:)

      n = unknowns(s, s%n_harmonics)
      bytes%structure = copies_kept*real_bytes*s%n_dofs**2 + interior_bytes(s)
      bytes%linear = linear_bytes(s, s%n_harmonics) + 2*complex_bytes*s%n_dofs*s%n_harmonics
      bytes%samples = sample_bytes(s, s%n_harmonics, s%samples, .true., .true.)
      bytes%results = complex_bytes*s%n_harmonics*(2*s%n_stored_dofs + 3*s%n_law_dofs + s%n_dofs)
      if (size(s%stored_samples) > 0) bytes%results = bytes%results + linear_bytes(s, s%n_harmonics) &
         + sample_bytes(s, s%n_harmonics, s%stored_samples, .false., .false.) &
         + 4*real_bytes*s%n_law_dofs*volume(s%stored_samples)
      if (s%n_law_dofs <= 0) bytes%samples = 0
      if (s%n_law_dofs <= 0) return

      bytes%tangent = real_bytes*(n*n + 12*n + table_size(s%highest)*2.5_wp)
      if (s%solver%method == method%broyden) bytes%tangent = bytes%tangent + 2*real_bytes*n*s%solver%memory
      if (s%solver%rescue) bytes%rescue = 2*real_bytes*n*n + real_bytes*(20*n + table_size(s%highest)*2.5_wp)
      if (s%solver%rescue) bytes%rescue = max(bytes%rescue, real_bytes*(n*n + 2*n*s%solver%memory))
      if (.not. s%has_certificate) return
      orders = wider_orders(s%highest)
      samples = wider_samples(s%samples, orders)
      n_wide = 0.5_wp*(volume(2*orders + 1) + 1)
      bytes%certificate = real_bytes*(n*n + 4*unknowns(s, n_wide)) + linear_bytes(s, n_wide) &
                          + complex_bytes*s%n_dofs*n_wide + sample_bytes(s, n_wide, samples, .true., .false.)
   end function estimate_memory

   !> Bytes of a point whose direct attempt succeeds.
   pure real(wp) function memory_estimate_usual(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_usual = of_program + self%structure + self%linear + self%samples + self%results + &
                              max(self%tangent, self%certificate)
   end function memory_estimate_usual

   !> Bytes of a point that needs all that its settings allow.
   pure real(wp) function memory_estimate_worst(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_worst = self%usual() + max(0.0_wp, self%rescue - max(self%tangent, self%certificate))
   end function memory_estimate_worst

   !> Fails for sizes that need more than `limit` bytes or cannot be counted; the message names the main parts and what
   !> would fit.
   subroutine check_memory(s, limit, error)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit                                   !! bytes for this process
      type(error_t), allocatable, intent(out) :: error
      type(memory_estimate_t) :: bytes

      if (max(unknowns(s, s%n_harmonics), table_size(s%highest)) > real(huge(1), wp)) then
         call fail(error, "there would be "//to_text(anint(unknowns(s, s%n_harmonics)))//" unknowns, more than can be counted; "// &
                   "lower the order of the harmonics")
         return
      end if
      bytes = estimate_memory(s)
      if (bytes%worst() <= limit) return
      call fail(error, "this point would need "//amount(bytes%worst())//" of memory, "//amount(limit)// &
                " are there for each process: "//memory_text(bytes)//". "//what_fits(s, limit))
   end subroutine check_memory

   !> The parts that matter, the largest first: such as `tangent 3.1 GiB, samples 0.4 GiB`.
   pure function memory_text(bytes) result(text)
      type(memory_estimate_t), intent(in) :: bytes
      character(:), allocatable :: text
      character(11), parameter :: names(7) = [character(11) :: &
         "structure", "linear part", "samples", "tangent", "rescue", "certificate", "results"]
      real(wp) :: parts(7)
      integer :: i, k

      parts = [bytes%structure, bytes%linear, bytes%samples, bytes%tangent, bytes%rescue, bytes%certificate, bytes%results]
      text = ""
      do k = 1, size(parts)
         i = maxloc(parts, dim=1)
         if (parts(i) < 0.01_wp*bytes%worst() .and. k > 1) return
         if (k > 1) text = text//", "
         text = text//trim(names(i))//" "//amount(parts(i))
         parts(i) = -1.0_wp
      end do
   end function memory_text

   !> What to change, alone, so that the point fits: the settings that cost most, and the highest order that fits.
   function what_fits(s, limit) result(text)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit
      character(:), allocatable :: text
      type(sizes_t) :: other
      integer :: fits, half, too_little

      text = ""
      other = s
      other%solver%rescue = .false.
      call offer("&solver rescue = .false.")
      other%has_certificate = .false.
      call offer("the same and &certificate is_on = .false.")
      too_little = 0
      fits = maxval(s%highest)
      do while (fits - too_little > 1)                                 ! bisection
         half = too_little + (fits - too_little)/2
         call lower_order(s, half, other)
         if (worst_of(other) <= limit) then
            fits = half
         else
            too_little = half
         end if
      end do
      call lower_order(s, fits, other)
      if (fits > 0) call offer("order "//to_text(maxval(other%highest))//" instead of "//to_text(maxval(s%highest))// &
                               " with at most "//to_text(maxval(other%samples))//" samples a tone")
      if (len(text) == 0) then
         text = "No lower order would fit; take a smaller structure or more memory (&solver memory_limit, in GiB)"
      else
         text = "What would fit: "//text
      end if

   contains

      subroutine offer(change)
         character(*), intent(in) :: change

         if (worst_of(other) > limit) return
         if (len(text) > 0) text = text//"; "
         text = text//change//" ("//amount(worst_of(other))//")"
      end subroutine offer
   end function what_fits

   pure real(wp) function worst_of(s)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes

      bytes = estimate_memory(s)
      worst_of = bytes%worst()
   end function worst_of

   !> The sizes with every order lower by `lower` (not below 1), harmonics and samples in proportion.
   pure subroutine lower_order(s, lower, other)
      type(sizes_t), intent(in) :: s
      integer, intent(in) :: lower
      type(sizes_t), intent(out) :: other
      real(wp) :: share(size(s%highest))

      other = s
      other%highest = max(min(s%highest, 1), s%highest - lower)
      share = real(2*other%highest + 1, wp)/real(2*s%highest + 1, wp)
      other%n_harmonics = max(1.0_wp, s%n_harmonics*product(share))
      other%samples = ceiling(share*s%samples)
   end subroutine lower_order

   !> Unknowns of a set of that many harmonics.
   pure real(wp) function unknowns(s, n_harmonics)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics

      unknowns = 2*n_harmonics*s%n_law_dofs
   end function unknowns

   !> Factors of the interior at one frequency, see hb_block_solver.
   pure real(wp) function interior_bytes(s)
      type(sizes_t), intent(in) :: s
      real(wp) :: n_rows

      n_rows = 3*s%bandwidth + 1
      if (2*n_rows > s%n_dofs) n_rows = s%n_dofs
      interior_bytes = complex_bytes*s%n_dofs*(n_rows + s%n_law_dofs + 2) + 88*s%n_entries
   end function interior_bytes

   !> Condensed stiffness, twice (the balance keeps a copy), and its factors; see hb_dynamic_stiffness.
   pure real(wp) function linear_bytes(s, n_harmonics)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics

      associate (l => s%n_law_dofs)
         linear_bytes = complex_bytes*n_harmonics*(2*(s%n_dofs*(l + 1) + 1.5_wp*l) + l*l + 4*l) &
                        + integer_bytes*n_harmonics*(size(s%highest) + 4)
      end associate
   end function linear_bytes

   !> All that a balance keeps on a grid; see hb_transform, hb_law_set and what they use.
   pure real(wp) function sample_bytes(s, n_harmonics, samples, with_derivatives, with_answers)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics
      integer, intent(in) :: samples(:)
      logical, intent(in) :: with_derivatives
      logical, intent(in) :: with_answers                             !! to every coefficient, of laws with memory
      real(wp) :: blocks, kinds, n_slice, n_steps, per_sample

      blocks = 2 + merge(1, 0, s%needs_velocity) + merge(1, 0, s%needs_reaction) + merge(3, 0, s%has_memory)
      per_sample = s%n_law_dofs*(blocks + 1 + 2.0_wp/samples(1)) + s%laws_per_sample
      if (s%has_memory) per_sample = per_sample + 1.5_wp              ! order of the walk, one answer
      if (with_derivatives) then
         kinds = 1 + merge(1, 0, s%needs_velocity) + merge(1, 0, s%needs_reaction)
         per_sample = per_sample + kinds*s%n_pairs + s%derivatives_per_sample
      end if
      if (with_answers) per_sample = per_sample + s%answers_per_sample
      sample_bytes = real_bytes*per_sample*volume(samples)
      if (.not. s%has_memory) return
      n_steps = minval(samples)
      n_slice = volume(samples)/n_steps
      sample_bytes = sample_bytes + integer_bytes*4.0_wp**(size(samples) - 1)*n_slice
      if (with_answers) sample_bytes = sample_bytes + &
         2*real_bytes*n_harmonics*(s%states*n_slice + n_slice + maxval(samples))
   end function sample_bytes

   !> Entries of the table of products, see hb_transform.
   pure real(wp) function table_size(highest)
      integer, intent(in) :: highest(:)

      table_size = product(4*real(highest, wp) + 1)
   end function table_size

   pure real(wp) function volume(samples)
      integer, intent(in) :: samples(:)

      volume = product(real(samples, wp))
   end function volume

   !> Bytes in words, such as 0.25 GiB or 12 MiB.
   pure function amount(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(:), allocatable :: text
      character(40) :: buffer

      if (bytes >= 1.0e6_wp*gib) then
         write (buffer, "(es8.1, a)") bytes/gib, " GiB"
      else if (bytes >= 0.95_wp*gib) then
         write (buffer, "(f12.1, a)") bytes/gib, " GiB"
      else
         write (buffer, "(f12.0, a)") bytes/gib*1024.0_wp, " MiB"
         buffer = buffer(:11)//buffer(13:)                            ! without the point
      end if
      text = trim(adjustl(buffer))
   end function amount
end module hb_memory_estimate
