!> Free vibration of a linear structure: growth rates, frequencies and shapes of its oscillatory modes; natural frequencies in
!> vacuum, without damping, dynamic stiffness or laws.
!>
!> q(t) = Re(shape exp((growth + i frequency) t)) solves M q'' + D q' + K q = 0. The quadratic eigenvalue problem is
!> solved in its first companion form with time scaled by sqrt(max |K|/max |M|), without masses by max |K|/max |D|, by the
!> QZ algorithm, which permits zero masses. Source: Tisseur and Meerbergen, SIAM Review 43 (2001) 235-286, sections 3.4 and 5.
module hb_modes
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_lapack, only: dgeev, dgemm, dggev, dpotrf, dpotrs, dsygv
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   implicit none
   private
   public :: fastest_frequency, find_natural_frequencies, has_free_motion, max_dofs, modes_t, natural_frequencies, new_modes
   public :: slowest_decay

   integer, parameter :: largest_structure = 500                      ! degrees of freedom: all modes are computed
   integer, parameter :: max_dofs = 1500               !! for natural frequencies alone, computed at once in some seconds
   integer, parameter :: max_gyroscopic_dofs = 200     ! likewise, with gyroscopic terms
   integer, parameter :: max_of_all = 100              ! degrees of freedom up to which all modes cost next to nothing

   type :: modes_t
      integer :: n_modes = 0
      real(wp), allocatable :: growth(:)                              !! [1/s], (n_modes), positive: unstable
      real(wp), allocatable :: frequency(:)                           !! [rad/s], (n_modes), > 0, ascending
      real(wp), allocatable :: response(:)                            !! d growth/d xi for forces -xi M q', (n_modes): 1/2
                                                                      !! without gyroscopic terms, otherwise of either sign
      complex(wp), allocatable :: shapes(:, :)                        !! (n_dofs, n_modes), of any magnitude
   end type modes_t

contains

   !> Computes all oscillatory modes. Fails for a structure that is too large and if LAPACK does not converge.
   subroutine new_modes(self, mass, damping, stiffness, error)
      type(modes_t), intent(out) :: self
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)   !! (n_dofs, n_dofs)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, k

      if (size(mass, 1) > largest_structure) then
         call fail(error, "modes: "//to_text(size(mass, 1))//" degrees of freedom are more than the "// &
                   to_text(largest_structure)//" for which all modes are computed")
         return
      end if
      call find_modes(self, mass, damping, stiffness, "V", error)
      if (allocated(error)) return
      allocate (self%response(self%n_modes))
      do i = 1, self%n_modes
         self%response(i) = response_of(self%shapes(:, i), cmplx(self%growth(i), self%frequency(i), wp), mass, damping)
      end do
      do i = 2, self%n_modes                                           ! insertion sort: there are few
         k = i
         do while (k > 1)
            if (self%frequency(k - 1) <= self%frequency(k)) exit
            call exchange(self, k - 1, k)
            k = k - 1
         end do
      end do
   end subroutine new_modes

   !> Growth rates, frequencies and, if job is "V", shapes of the oscillatory modes, in any order. The general method needs some
   !> times as long as the others, which counts for large structures only.
   subroutine find_modes(self, mass, damping, stiffness, job, error)
      type(modes_t), intent(out) :: self
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)   !! (n_dofs, n_dofs)
      character, intent(in) :: job                                    !! "V", or "N" without shapes
      type(error_t), allocatable, intent(out) :: error
      logical :: is_found

      is_found = .false.
      if (size(mass, 1) > max_of_all) then
         call find_decoupled_modes(self, mass, damping, stiffness, is_found)
         if (.not. is_found) call find_explicit_modes(self, mass, damping, stiffness, job, is_found)
      end if
      if (.not. is_found) call find_general_modes(self, mass, damping, stiffness, job, error)
   end subroutine find_modes

   !> The modes of any structure, by the QZ algorithm.
   subroutine find_general_modes(self, mass, damping, stiffness, job, error)
      type(modes_t), intent(out) :: self
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)   !! (n_dofs, n_dofs)
      character, intent(in) :: job                                    !! "V", or "N" without shapes
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: a(:, :), b(:, :), alpha_r(:), alpha_i(:), beta(:), shapes(:, :), work(:)
      real(wp) :: left(1, 1), rate, scale
      integer, allocatable :: found(:)
      integer :: i, info, n

      n = size(mass, 1)
      scale = maxval(abs(stiffness))
      if (scale <= 0.0_wp) scale = 1.0_wp
      if (any(abs(mass) > 0.0_wp)) then
         rate = sqrt(scale/maxval(abs(mass)))
      else                                                            ! equations of first order
         rate = scale/max(maxval(abs(damping)), tiny(1.0_wp)*scale)
      end if
      allocate (a(2*n, 2*n), b(2*n, 2*n), source=0.0_wp)
      allocate (alpha_r(2*n), alpha_i(2*n), beta(2*n), shapes(2*n, 2*n), work(16*n))
      do i = 1, n
         a(i, n + i) = 1.0_wp
         b(i, i) = 1.0_wp
      end do
      a(n + 1:, :n) = -stiffness/scale
      a(n + 1:, n + 1:) = -damping*(rate/scale)
      b(n + 1:, n + 1:) = mass*(rate**2/scale)
      call dggev("N", job, 2*n, a, 2*n, b, 2*n, alpha_r, alpha_i, beta, left, 1, shapes, 2*n, work, size(work), info)
      if (info /= 0) then
         call fail(error, "modes: the eigenvalues of the linear structure were not found (dggev: "//to_text(info)//")")
         return
      end if
      found = pack([(i, i=1, 2*n)], alpha_i > 0.0_wp .and. beta > epsilon(1.0_wp)*(abs(alpha_r) + abs(alpha_i)))
      self%n_modes = size(found)
      self%growth = rate*alpha_r(found)/beta(found)
      self%frequency = rate*alpha_i(found)/beta(found)
      if (job == "V") self%shapes = cmplx(shapes(:n, found), shapes(:n, found + 1), wp)
   end subroutine find_general_modes

   !> The modes if those without damping decouple the equations, as with damping proportional to mass and stiffness.
   subroutine find_decoupled_modes(self, mass, damping, stiffness, is_found)
      type(modes_t), intent(out) :: self
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)   !! (n_dofs, n_dofs)
      logical, intent(out) :: is_found
      real(wp), parameter :: max_coupling_of_modes = 1.0e-10_wp       ! of a damping between modes, relative to the largest
      real(wp), allocatable :: b(:, :), damped(:, :), modal(:, :), rates(:), shapes(:, :), squares(:), work(:)
      integer, allocatable :: found(:)
      integer :: i, info, n

      n = size(mass, 1)
      is_found = .not. (is_unsymmetric(mass) .or. is_unsymmetric(damping) .or. is_unsymmetric(stiffness))
      if (.not. is_found) return
      allocate (shapes, source=stiffness)
      allocate (b, source=mass)
      allocate (squares(n), work(35*n), damped(n, n), modal(n, n))
      call dsygv(1, "V", "U", n, shapes, n, b, n, squares, work, size(work), info)
      is_found = info == 0
      if (.not. is_found) return
      call dgemm("N", "N", n, n, n, 1.0_wp, damping, n, shapes, n, 0.0_wp, damped, n)
      call dgemm("T", "N", n, n, n, 1.0_wp, shapes, n, damped, n, 0.0_wp, modal, n)
      allocate (rates, source=[(-0.5_wp*modal(i, i), i=1, n)])
      do i = 1, n
         modal(i, i) = 0.0_wp
      end do
      is_found = maxval(abs(modal)) <= max_coupling_of_modes*2.0_wp*maxval(abs(rates))
      if (.not. is_found) return
      squares = squares - rates**2
      found = pack([(i, i=1, n)], squares > 0.0_wp)
      self%n_modes = size(found)
      self%growth = rates(found)
      self%frequency = sqrt(squares(found))
      self%shapes = cmplx(shapes(:, found), 0.0_wp, wp)
   end subroutine find_decoupled_modes

   !> The modes of a structure whose masses permit its equations to be solved for the accelerations.
   subroutine find_explicit_modes(self, mass, damping, stiffness, job, is_found)
      type(modes_t), intent(out) :: self
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)   !! (n_dofs, n_dofs)
      character, intent(in) :: job                                    !! "V", or "N" without shapes
      logical, intent(out) :: is_found
      real(wp), allocatable :: a(:, :), factor(:, :), imaginary_part(:), real_part(:), right(:, :), shapes(:, :), work(:)
      real(wp) :: left(1, 1), rate
      integer, allocatable :: found(:)
      integer :: i, info, n

      n = size(mass, 1)
      is_found = .not. is_unsymmetric(mass)
      if (.not. is_found) return
      allocate (factor, source=mass)
      call dpotrf("L", n, factor, n, info)
      is_found = info == 0 .and. any(abs(stiffness) > 0.0_wp)
      if (.not. is_found) return
      rate = sqrt(maxval(abs(stiffness))/maxval(abs(mass)))
      allocate (a(2*n, 2*n), source=0.0_wp)
      do i = 1, n
         a(i, n + i) = 1.0_wp
      end do
      allocate (right, source=-stiffness/rate**2)
      call dpotrs("L", n, n, factor, n, right, n, info)
      a(n + 1:, :n) = right
      right = -damping/rate
      call dpotrs("L", n, n, factor, n, right, n, info)
      a(n + 1:, n + 1:) = right
      allocate (real_part(2*n), imaginary_part(2*n), shapes(2*n, 2*n), work(70*n))
      call dgeev("N", job, 2*n, a, 2*n, real_part, imaginary_part, left, 1, shapes, 2*n, work, size(work), info)
      is_found = info == 0
      if (.not. is_found) return
      found = pack([(i, i=1, 2*n)], imaginary_part > 0.0_wp)
      self%n_modes = size(found)
      self%growth = rate*real_part(found)
      self%frequency = rate*imaginary_part(found)
      if (job == "V") self%shapes = cmplx(shapes(:n, found), shapes(:n, found + 1), wp)
   end subroutine find_explicit_modes

   !> Real part of d lambda/d xi = lambda m/(2 lambda m + d), m and d the products of the shape with mass and damping: exact
   !> to first order in what is neither symmetric nor gyroscopic.
   pure real(wp) function response_of(shape, lambda, mass, damping)
      complex(wp), intent(in) :: shape(:), lambda
      real(wp), intent(in) :: mass(:, :), damping(:, :)
      complex(wp) :: d, m
      real(wp), dimension(size(shape)) :: imaginary_part, real_part

      real_part = real(shape)
      imaginary_part = aimag(shape)
      m = dot_product(shape, cmplx(matmul(mass, real_part), matmul(mass, imaginary_part), wp))
      d = dot_product(shape, cmplx(matmul(damping, real_part), matmul(damping, imaginary_part), wp))
      response_of = real(lambda*m/(2.0_wp*lambda*m + d))
   end function response_of

   pure subroutine exchange(self, i, k)
      type(modes_t), intent(inout) :: self
      integer, intent(in) :: i, k

      self%growth([i, k]) = self%growth([k, i])
      self%frequency([i, k]) = self%frequency([k, i])
      self%response([i, k]) = self%response([k, i])
      self%shapes(:, [i, k]) = self%shapes(:, [k, i])
   end subroutine exchange

   !> Decay rate [1/s] of the slowest decaying mode; 0 if none decays or if it is unknown.
   real(wp) function slowest_decay(mass, damping, stiffness) result(rate)
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)   !! (n_dofs, n_dofs)
      type(error_t), allocatable :: error
      type(modes_t) :: modes

      rate = 0.0_wp
      if (size(mass, 1) > largest_structure) return
      call find_modes(modes, mass, damping, stiffness, "N", error)
      if (allocated(error)) return
      if (any(modes%growth < 0.0_wp)) rate = minval(-modes%growth, mask=modes%growth < -1.0e-9_wp*modes%frequency)
      if (rate >= huge(1.0_wp)) rate = 0.0_wp
   end function slowest_decay

   pure logical function is_unsymmetric(matrix)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), parameter :: asymmetry_rounding = 1.0e-14_wp

      is_unsymmetric = any(abs(matrix - transpose(matrix)) > asymmetry_rounding*maxval(abs(matrix)))
   end function is_unsymmetric

   !> Frequency of the fastest mode without damping [rad/s], within a percent and rather too high than too low for large structures,
   !> where what is unsymmetric in the stiffness is left out; 0 if none is found.
   !>
   !> Lanczos' method for M^-1 K, orthogonal with respect to M, whose largest eigenvalues converge first. The residual of the
   !> largest one is added to it. Source: Zhou and Li, Linear Algebra and its Applications 435 (2011) 480-493.
   real(wp) function fastest_frequency(mass, stiffness) result(fastest)
      real(wp), intent(in) :: mass(:, :), stiffness(:, :)             !! (n_dofs, n_dofs)
      integer, parameter :: n_steps = 60
      type(error_t), allocatable :: error
      type(modes_t) :: modes
      real(wp) :: alpha(n_steps), beta(n_steps), ritz(n_steps, n_steps), unit(n_steps, n_steps), values(n_steps), work(35*n_steps)
      real(wp), allocatable :: all_of_them(:), basis(:, :), factor(:, :), heavy(:, :), w(:)
      integer :: i, info, k, n

      fastest = 0.0_wp
      n = size(mass, 1)
      if (n <= max_of_all) then
         call new_modes(modes, mass, 0.0_wp*mass, stiffness, error)
         if (.not. allocated(error) .and. modes%n_modes > 0) fastest = maxval(modes%frequency)
         return
      end if
      allocate (factor, source=mass)
      call dpotrf("L", n, factor, n, info)
      if (info /= 0) then                                             ! no mass somewhere
         if (n <= max_dofs) all_of_them = natural_frequencies(mass, stiffness)
         if (allocated(all_of_them)) fastest = max(0.0_wp, maxval(all_of_them))
         if (fastest >= huge(1.0_wp)) fastest = 0.0_wp
         return
      end if
      allocate (basis(n, n_steps), heavy(n, n_steps), source=0.0_wp)
      w = [(1.0_wp + 0.5_wp*sin(real(i, wp)**2), i=1, n)]
      w = w*merge(1.0_wp, -1.0_wp, mod([(i, i=1, n)], 2) == 0)        ! fast modes alternate
      do k = 1, n_steps
         heavy(:, k) = matmul(mass, w)
         basis(:, k) = w/sqrt(dot_product(w, heavy(:, k)))
         heavy(:, k) = heavy(:, k)/sqrt(dot_product(w, heavy(:, k)))
         w = 0.5_wp*(matmul(stiffness, basis(:, k)) + matmul(basis(:, k), stiffness))
         call dpotrs("L", n, 1, factor, n, w, n, info)
         alpha(k) = dot_product(w, heavy(:, k))
         do i = 1, 2                                                  ! twice is enough
            w = w - matmul(basis(:, :k), matmul(w, heavy(:, :k)))
         end do
         beta(k) = sqrt(max(0.0_wp, dot_product(w, matmul(mass, w))))
         if (beta(k) <= epsilon(1.0_wp)*maxval(abs(alpha(:k)))) exit
      end do
      k = min(k, n_steps)
      ritz = 0.0_wp
      unit = 0.0_wp
      do i = 1, k
         ritz(i, i) = alpha(i)
         unit(i, i) = 1.0_wp
         if (i < k) ritz(i, i + 1) = beta(i)
      end do
      call dsygv(1, "V", "U", k, ritz, n_steps, unit, n_steps, values, work, size(work), info)
      if (info == 0) fastest = sqrt(max(0.0_wp, values(k) + beta(k)*abs(ritz(k, k))))
   end function fastest_frequency

   !> Whether some part can move without stiffness; false for large structures.
   logical function has_free_motion(mass, stiffness)
      real(wp), intent(in) :: mass(:, :), stiffness(:, :)             !! (n_dofs, n_dofs)
      real(wp), parameter :: zero_ratio = 1.0e-6_wp                   ! relative to the largest entries

      has_free_motion = .false.
      if (size(mass, 1) > largest_structure .or. .not. any(abs(mass) > 0.0_wp)) return
      has_free_motion = any(abs(natural_frequencies(mass, stiffness)) <= zero_ratio*sqrt(maxval(abs(stiffness))/maxval(abs(mass))))
   end function has_free_motion

   !> Returns all finite natural frequencies, ascending; 0 for a motion without stiffness, negative for the growth
   !> rate at the equilibrium if the stiffness is negative. No value if LAPACK finds none: the structure has massless
   !> parts without support.
   !>
   !> If the stiffness is positive definite, M v = mu K v is solved, whose largest eigenvalues are the lowest
   !> frequencies to all digits and which permits zero masses; otherwise K v = lambda M v.
   function natural_frequencies(mass, stiffness) result(frequencies)
      real(wp), intent(in) :: mass(:, :), stiffness(:, :)             !! (n_dofs, n_dofs)
      real(wp), allocatable :: frequencies(:)                         !! [rad/s]
      real(wp), allocatable :: a(:, :), b(:, :), values(:), work(:)
      integer :: info, n

      n = size(mass, 1)
      allocate (values(n), work(max(1, 3*n)))
      a = 0.5_wp*(mass + transpose(mass))
      b = 0.5_wp*(stiffness + transpose(stiffness))
      call dsygv(1, "N", "U", n, a, n, b, n, values, work, size(work), info)
      if (info == 0) then
         values = values(n:1:-1)
         frequencies = 1.0_wp/sqrt(pack(values, values > n*epsilon(1.0_wp)*maxval(values)))
         return
      end if
      a = 0.5_wp*(stiffness + transpose(stiffness))
      b = 0.5_wp*(mass + transpose(mass))
      call dsygv(1, "N", "U", n, a, n, b, n, values, work, size(work), info)
      if (info == 0) then
         where (abs(values) <= n*epsilon(1.0_wp)*maxval(abs(values))) values = 0.0_wp
         frequencies = sign(sqrt(abs(values)), values)
      else
         allocate (frequencies(0))
      end if
   end function natural_frequencies

   !> Finds the natural frequencies in ascending order, with gyroscopic terms for structures of up to 200 degrees of freedom, as far
   !> as a reduced structure is valid. None for large or sparse structures, or if some part has neither mass nor support. A negative
   !> one is the growth rate of an unstable structure.
   subroutine find_natural_frequencies(structure, frequencies, lacks_gyroscopic)
      type(structure_t), intent(in) :: structure
      real(wp), allocatable, intent(out) :: frequencies(:)            !! [rad/s]
      logical, intent(out) :: lacks_gyroscopic                        !! gyroscopic terms exist and are left out
      type(error_t), allocatable :: error
      type(modes_t) :: modes

      allocate (frequencies(0))
      lacks_gyroscopic = .false.
      if (structure%n_dofs > max_dofs .or. allocated(structure%sparse)) return
      deallocate (frequencies)
      lacks_gyroscopic = any(abs(structure%damping - transpose(structure%damping)) > 0.0_wp)
      if (lacks_gyroscopic .and. structure%n_dofs <= max_gyroscopic_dofs) then
         call new_modes(modes, structure%mass, 0.5_wp*(structure%damping - transpose(structure%damping)), structure%stiffness, &
                        error)
         if (.not. allocated(error)) frequencies = modes%frequency
      end if
      lacks_gyroscopic = lacks_gyroscopic .and. .not. allocated(frequencies)
      if (.not. allocated(frequencies)) frequencies = natural_frequencies(structure%mass, structure%stiffness)
      if (structure%up_to > 0.0_wp) frequencies = pack(frequencies, frequencies <= structure%up_to)
   end subroutine find_natural_frequencies
end module hb_modes
